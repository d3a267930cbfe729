"""What every method hides of a photograph as rain or as a passer-by, beside the rain that was drawn, to look at.

    python -m benchmarks.hidden_pictures --scene courtyard --pattern raindrop-1 --view 020

Takes the pictures that finished runs of the pattern have left of some training views; draws them in order of name.
"""

from collections.abc import Mapping
from pathlib import Path

from benchmarks.rain_pictures import grey, view_named
from hydroviews.cli.commands import run_command
from hydroviews.dataset.variants import open_clean, open_variant
from hydroviews.errors import InputError
from hydroviews.scene.images import Image, read_image, write_png
from hydroviews.scene.picture_grid import Row, Tile, draw_sheet
from leaderboard.records import GIVEN_POSES, run_folder
from leaderboard.runs.train_and_render import HIDDEN
from leaderboard.site.hidden_pictures import true_cover

WIDTH, COLUMNS = 1600, 4  # pixels and pictures across


def hidden_of_methods(runs: Path, scene: str, pattern: str, seed: int, view: str) -> Mapping[str, Image]:
    """By method, what it hides of a view.

    Args:
        runs: folder of a profile in a results folder.
        scene: its name.
        pattern: its name.
        seed: of the runs.
        view: name of a training view.

    Raises:
        InputError: no run has hidden anything of this view.
    """
    methods = sorted(one.name for one in runs.iterdir() if one.is_dir())
    folders = {name: run_folder(runs.parent, runs.name, name, scene, pattern, seed, GIVEN_POSES) for name in methods}
    found = {name: folder / HIDDEN / f"{view}.png" for name, folder in folders.items()}
    pictures = {name: read_image(path) for name, path in found.items() if path.is_file()}
    if not pictures:
        there = {path.stem for folder in folders.values() for path in (folder / HIDDEN).glob("*.png")}
        raise InputError(
            f"--view {view}: no run has hidden anything of it", found=", ".join(sorted(there)) or "no runs"
        )
    return pictures


def main(
    scene: str = "courtyard",
    pattern: str = "raindrop-1",
    view: str = "020",
    seed: int = 0,
    profile: str = "demo",
    data: Path = Path("data"),
    results: Path = Path("results"),
    out: Path = Path("results/bench/hidden.png"),
) -> None:
    """Draw the picture.

    Args:
        scene: that the runs are of.
        pattern: that they learned from.
        view: name of a training view of which runs keep what they hide.
        seed: of the runs.
        profile: of the runs.
        data: folder that `make eval` built in.
        results: folder of the runs.
        out: the picture, PNG.
    """
    hidden = hidden_of_methods(results / profile, scene, pattern, seed, view)
    built = data / profile / scene
    tiles = [
        Tile(view_named(open_clean(built).views, view).image(), "clean view"),
        Tile(view_named(open_variant(built, pattern).views, view).image(), "photograph"),
        Tile(grey(true_cover(built / pattern, view)), "rain, as drawn"),
        *(Tile(picture, name) for name, picture in hidden.items()),
    ]
    rows = [Row("", "", tiles[i : i + COLUMNS]) for i in range(0, len(tiles), COLUMNS)]
    write_png(out, draw_sheet(f"{scene}, {pattern}", f"view {view}: white is hidden", rows, WIDTH))
    print(out)


if __name__ == "__main__":
    run_command(main, prog="benchmarks.hidden_pictures")
