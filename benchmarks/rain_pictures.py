"""What methods of this project found of the rain in a photograph, beside what was there, for people to look at.

    python -m benchmarks.rain_pictures --runs RUN [RUN ...] --view NAME

Runs are folders of finished runs of `deraings`, `deraings-plus` or the ablation. Every row: the photograph, enhanced if
the method enhances, the cover that was found, the true one, the render, the clean view.
"""

from pathlib import Path

import numpy as np

from baselines.method import find_method
from benchmarks.ground_truth import true_covers
from deraings.image_planes import Plane
from deraings.method import DeRainGS
from deraings.rain_model.objective import RainObjective
from hydroviews.cli.commands import run_command
from hydroviews.errors import InputError
from hydroviews.scene.images import read_image, write_png
from hydroviews.scene.picture_grid import Row, Tile, draw_sheet
from hydroviews.scene.scenes import View
from leaderboard.runs.finished_runs import open_run
from leaderboard.runs.run import Run
from leaderboard.runs.train_and_render import only_training

WIDTH = 1800  # pixels of the picture


def found_cover(objective: RainObjective, view: int, size: tuple[int, int], falling: bool) -> Plane:
    """What covers a training view [H, W], by all that was learned: falling rain, or what is on the lens."""
    if falling:
        return objective.model.rain_alpha(view, size)
    shown = 1 - objective.model.drop_alpha(view, size)
    return 1 - shown if objective.masks is None else 1 - shown * (1 - objective.masks.mask(view, size))


def row_of(run: Run, name: str) -> Row:
    """One run's row.

    Raises:
        InputError: no such training view, a method that looks for no rain, or an effect without layers to compare.
    """
    scene, kind = only_training(run.training_scene()), find_method(run.method)
    method = kind(kind.configuration(run.profile), run.seed)
    names = [view.name for view in scene.train_views]
    if name not in names:
        raise InputError(f"--view {name}: no training view of {run}", expected=f"one of {', '.join(names)}")
    index = names.index(name)
    view, clean = scene.train_views[index], view_named(run.clean_scene().train_views, name)
    truth = true_covers(run.data / run.scene / run.pattern, view)
    part = next((part for part in ("rain", "drops") if part in truth), None)
    if not isinstance(method, DeRainGS) or part is None:
        raise InputError(
            f"{run}: nothing to compare", expected="a run of deraings or deraings-plus on drops or falling rain"
        )
    method.fit(scene, run.folder)  # finished: it only takes up what was learned
    size = view.camera.height, view.camera.width
    objective = method.learned()
    tiles = [Tile(view.image(), "photograph")]
    enhanced = sorted((run.folder / "enhanced").glob(f"*/{name}.png"))
    tiles += [Tile(read_image(enhanced[-1]), "enhanced")] if enhanced else []
    found = found_cover(objective, index, size, part == "rain")
    tiles += [Tile(grey(found), "rain that was found")]
    tiles += [Tile(grey(truth[part]), "rain that was there")]
    tiles += [Tile(method.render(view.camera), "render"), Tile(clean.image(), "clean view")]
    return Row(f"{run.method} on {run.scene}", run.pattern, tiles)


def grey(plane: Plane) -> np.ndarray:
    """A plane [H, W] as a picture [H, W, 3]."""
    return np.repeat(np.clip(plane, 0, 1)[..., None], 3, axis=2).astype(np.float32)


def view_named(views: tuple[View, ...], name: str) -> View:
    """The view of that name, which is there."""
    return next(view for view in views if view.name == name)


def main(
    runs: tuple[Path, ...], view: str, data: Path = Path("data"), out: Path = Path("results/bench/rain.png")
) -> None:
    """Draw the picture.

    Args:
        runs: folders of finished runs.
        view: name of a training view.
        data: folder that `make eval` built in.
        out: the picture, PNG.
    """
    rows = [row_of(open_run(run, data), view) for run in runs]
    write_png(out, draw_sheet("Rain found and rain there", f"view {view}", rows, WIDTH))
    print(out)


if __name__ == "__main__":
    run_command(main, prog="benchmarks.rain_pictures")
