"""One picture a run, for people who would rather look than read: input, render, truth, error."""

import cv2
import numpy as np
from numpy.typing import NDArray

from baselines.training.images import evenly_spread
from hydroviews.dataset.clean_views import CLEAN
from hydroviews.dataset.variants import open_variant
from hydroviews.scene.images import Image, read_image, write_png
from hydroviews.scene.masks import Ignored
from hydroviews.scene.scenes import Scene
from leaderboard.runs.own_files import PREVIEW, RENDERS
from leaderboard.runs.run import Run

ROWS = 3
ERROR_SCALE = 4.0  # an error of a quarter of the range is the top of the colour map
CAPTION = 20  # pixels


def write_preview(run: Run, scene: Scene) -> None:
    """Write `preview.png`: for a few held-out views the rainy view, the render, the clean view, the error.

    Args:
        run: with its renders.
        scene: the clean views; those captured in rain where there are no clean ones.
    """
    names = scene.split.test
    chosen = [names[i] for i in evenly_spread(len(names), ROWS)]
    views = {view.name: view for view in scene.test_views}
    shown = () if run.pattern == CLEAN else open_variant(run.data / run.scene, run.pattern).views
    rainy = {view.name: view for view in shown if view.path.is_file()}
    rows = []
    for name in chosen:
        panels = {"render": read_image(run.folder / RENDERS / f"{name}.png")}
        if not scene.captured_rainy:
            target = views[name].image()
            error = error_map(panels["render"], target, views[name].ignored())
            panels |= {"clean view": target, "error x4": error}
        if name in rainy:
            panels = {"rainy view": rainy[name].image(), **panels}
        rows.append(np.concatenate([_captioned(image, text) for text, image in panels.items()], axis=1))
    width = min(row.shape[1] for row in rows)  # views of different sizes: crop to the narrowest row
    write_png(run.folder / PREVIEW, np.concatenate([row[:, :width] for row in rows]))


def error_map(image: Image, target: Image, ignored: Ignored | None = None) -> Image:
    """Mean absolute error over the channels as a heat map [H, W, 3]: black none, bright a quarter of the range.

    Hidden pixels have none.
    """
    error = np.clip(np.abs(image - target).mean(axis=2) * ERROR_SCALE, 0, 1)
    if ignored is not None:
        error[ignored] = 0
    heat = cv2.applyColorMap((error * 255).astype(np.uint8), cv2.COLORMAP_INFERNO)
    return heat[..., ::-1].astype(np.float32) / 255


def _captioned(image: NDArray, text: str) -> Image:
    bar = np.full((CAPTION, image.shape[1], 3), 255, np.uint8)
    cv2.putText(bar, text, (4, CAPTION - 6), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (0, 0, 0), 1, cv2.LINE_AA)
    return np.concatenate([bar.astype(np.float32) / 255, image.astype(np.float32)])
