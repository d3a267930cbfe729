"""What methods take for something before the scene in some training views, beside the rain that was drawn on them."""

import logging
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from hydroviews.dataset.clean_views import CLEAN
from hydroviews.errors import InputError
from hydroviews.files.atomic import read_json
from hydroviews.formats.capture_json import CAPTURED
from hydroviews.rain.layers import read_layers
from hydroviews.rain.patterns import PATTERN_FILE
from hydroviews.rain.registry import find_effect
from hydroviews.scene.images import to_uint8
from leaderboard.records import SCORED
from leaderboard.runs.own_files import HIDDEN
from leaderboard.site.pictures import IMAGES, RAINY_VIEW, Pictures, Thumbnails, add_pictures, built_scene, view_pictures
from leaderboard.site.runs import ShownRun

logger = logging.getLogger(__name__)

TRUTH = "rain, as drawn"


def hidden_pictures(runs: Iterable[ShownRun], data: Path, thumbnails: Thumbnails) -> dict[str, Pictures]:
    """By pattern and seed of one scene, profile and track: rainy views, their rain, and what each method has hidden.

    Args:
        runs: of the scene.
        data: folder that the scenes were built in; rainy views and rain are left out where it has none, or others.
        thumbnails: take the small pictures.
    """
    found: dict[str, Pictures] = {}
    for run in runs:
        if run.record["status"] not in SCORED or run.record["pattern"] == CLEAN:
            continue
        paths = {path.stem: path for path in sorted((run.folder / HIDDEN).glob("*.png"))}
        if shown := add_pictures(paths, thumbnails):
            title = f"{run.record['pattern']}, seed {run.record['seed']}"
            if title not in found:
                found[title] = _given(run, data, list(paths), thumbnails)
            found[title][run.name] = shown
    return found


def _given(run: ShownRun, data: Path, views: Sequence[str], thumbnails: Thumbnails) -> Pictures:
    """Rainy views, and how much of them rain covers, if these are still the data that the run was made on."""
    profile, scene, pattern = (run.record[key] for key in ("profile", "scene", "pattern"))
    try:
        folder = built_scene(data, profile, scene, pattern, run.record["data_sha256"])
        found = {RAINY_VIEW: view_pictures(folder, folder / pattern / IMAGES, views, thumbnails)}
        if pattern != CAPTURED:
            found[TRUTH] = {view: _rain(folder / pattern, view, thumbnails) for view in views}
    except (InputError, FileNotFoundError) as error:
        logger.warning("no rain of %s/%s on the pages: %s", scene, pattern, error)
        return {}
    return found


def _rain(variant: Path, view: str, thumbnails: Thumbnails) -> str:
    layers = (variant / "layers" / f"{view}.exr").read_bytes()
    return thumbnails.add_as(layers, lambda: _grey(true_cover(variant, view)))


def true_cover(variant: Path, view: str) -> NDArray[np.float32]:
    """How much of each pixel [H, W] of a rainy view water, mist and streaks cover together, [0, 1], by its layers.

    Raises:
        InputError: missing or unreadable.
    """
    effect = find_effect(read_json(variant / PATTERN_FILE)["effect"])
    covers = effect.covers(read_layers(variant / "layers" / f"{view}.exr"))
    left = np.prod([1 - np.clip(cover, 0, 1) for cover in covers.values()], axis=0)
    return np.asarray(1 - left, np.float32)


def _grey(plane: NDArray[np.float32]) -> Image.Image:
    return Image.fromarray(to_uint8(plane)).convert("RGB")
