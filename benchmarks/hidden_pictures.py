"""What every method hides of a photograph as rain or as a passer-by, beside the rain that was drawn, to look at.

    python -m benchmarks.hidden_pictures --scene courtyard --pattern raindrop-1 --view 020

Takes the pictures that finished runs of the pattern have left of some training views; draws those of one view, and
prints how much each method hides of all of them, in drops and elsewhere.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from benchmarks.ground_truth import in_and_between_drops, true_covers
from benchmarks.rain_pictures import grey, view_named
from hydroviews.cli.commands import run_command
from hydroviews.dataset.variants import open_clean, open_variant
from hydroviews.errors import InputError
from hydroviews.scene.images import Image, read_image, write_png
from hydroviews.scene.picture_grid import Row, Tile, draw_sheet
from hydroviews.scene.scenes import Scene
from leaderboard.records import GIVEN_POSES, run_folder
from leaderboard.runs.own_files import HIDDEN
from leaderboard.site.hidden_pictures import true_cover

WIDTH, COLUMNS = 1600, 4  # pixels and pictures across


def hidden_by_methods(
    results: Path, profile: str, scene: str, pattern: str, seed: int, only: tuple[str, ...] = ()
) -> Mapping[str, Mapping[str, Image]]:
    """What runs hide of views [H, W, 3], grey, by method and by view's name.

    Args:
        results: folder of the runs.
        profile: theirs.
        scene: its name.
        pattern: its name.
        seed: of the runs.
        only: names of methods; all that have runs, if there are none.

    Raises:
        InputError: no run has hidden anything.
    """
    methods = only or sorted(one.name for one in (results / profile).iterdir() if one.is_dir())
    folders = {name: run_folder(results, profile, name, scene, pattern, seed, GIVEN_POSES) / HIDDEN for name in methods}
    found = {
        name: {path.stem: read_image(path) for path in sorted(folder.glob("*.png"))} for name, folder in folders.items()
    }
    if not any(found.values()):
        raise InputError(f"{results / profile}: no run of {scene}, {pattern}, seed {seed} has hidden anything")
    return {name: views for name, views in found.items() if views}


def picture(hidden: Mapping[str, Mapping[str, Image]], built: Path, pattern: str, view: str) -> NDArray[np.uint8]:
    """The clean view, the photograph, the rain as drawn, and what each method hides.

    Args:
        hidden: see `hidden_by_methods`.
        built: folder of the scene.
        pattern: its name.
        view: name of a training view.

    Raises:
        InputError: no run has hidden anything of this view.
    """
    pictures = {name: views[view] for name, views in hidden.items() if view in views}
    if not pictures:
        there = sorted({name for views in hidden.values() for name in views})
        raise InputError(f"--view {view}: no run has hidden anything of it", found=", ".join(there))
    tiles = [
        Tile(view_named(open_clean(built).views, view).image(), "clean view"),
        Tile(view_named(open_variant(built, pattern).views, view).image(), "photograph"),
        Tile(grey(true_cover(built / pattern, view)), "rain, as drawn"),
        *(Tile(shown, name) for name, shown in pictures.items()),
    ]
    rows = [Row("", "", tiles[i : i + COLUMNS]) for i in range(0, len(tiles), COLUMNS)]
    return draw_sheet(f"{built.name}, {pattern}", f"view {view}: white is hidden", rows, WIDTH)


def shares(hidden: Mapping[str, Mapping[str, Image]], variant: Path, scene: Scene) -> pd.DataFrame:
    """How much of a pixel each method hides, in drops and elsewhere: means over the views that it has drawn.

    Args:
        hidden: see `hidden_by_methods`.
        variant: folder of the rainy variant, with drops on the lens.
        scene: it.
    """
    names = {name for views in hidden.values() for name in views}
    drops = {name: true_covers(variant, view_named(scene.views, name))["drops"] for name in sorted(names)}
    rows = {
        method: in_and_between_drops((shown[..., 0], drops[name]) for name, shown in views.items())
        for method, views in hidden.items()
    }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("method").reset_index()


def main(
    scene: str = "courtyard",
    pattern: str = "raindrop-1",
    view: str = "020",
    seed: int = 0,
    methods: tuple[str, ...] = (),
    profile: str = "demo",
    data: Path = Path("data"),
    results: Path = Path("results"),
    out: Path = Path("results/bench/hidden.png"),
) -> None:
    """Draw the picture and print the table.

    Args:
        scene: that the runs are of.
        pattern: that they learned from, with drops on the lens.
        view: name of a training view of which runs keep what they hide.
        seed: of the runs.
        methods: whose runs are drawn; all that have hidden something, if none is named.
        profile: of the runs.
        data: folder that `make eval` built in.
        results: folder of the runs.
        out: the picture, PNG.
    """
    hidden = hidden_by_methods(results, profile, scene, pattern, seed, methods)
    built = data / profile / scene
    write_png(out, picture(hidden, built, pattern, view))
    print(out)
    print(shares(hidden, built / pattern, open_variant(built, pattern)).to_string(index=False))


if __name__ == "__main__":
    run_command(main, prog="benchmarks.hidden_pictures")
