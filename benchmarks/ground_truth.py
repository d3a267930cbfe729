"""What rain covers of a built variant's views, from the layers that no method may look at."""

from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np

from deraings.image_planes import Plane
from hydroviews.files.atomic import read_json
from hydroviews.rain.layers import read_layers
from hydroviews.rain.patterns import PATTERN_FILE
from hydroviews.rain.registry import find_effect
from hydroviews.scene.scenes import View

COVERED = 0.5  # of a pixel by drops, above which it counts as hidden
SHARES = {"drops": "water", "mist": "mist"}  # parts of the rain model, and what planes of layers count for


def true_covers(variant: Path, view: View) -> dict[str, Plane]:
    """What rain covers of a view, averaged down to its camera's size.

    Args:
        variant: folder of a rainy variant, such as `courtyard/raindrop-1`.
        view: one of its views.

    Returns:
        Planes [H, W], 0 to 1, as far as the variant's effect has such: `drops`, by water on the lens; `mist`; `rain`,
        by falling drops or streaks.

    Raises:
        InputError: missing or unreadable.
    """
    effect = find_effect(read_json(variant / PATTERN_FILE)["effect"])
    size = view.camera.width, view.camera.height
    layers = read_layers(variant / "layers" / f"{view.name}.exr")
    planes = {n: np.asarray(cv2.resize(p, size, interpolation=cv2.INTER_AREA), np.float32) for n, p in layers.items()}
    falling = {"rain": planes.pop(effect.falling)} if effect.falling else {}
    covers = effect.covers(planes)
    return {part: covers[share] for part, share in SHARES.items() if share in covers} | falling


def in_and_between_drops(views: Iterable[tuple[Plane, Plane]]) -> dict[str, float]:
    """Means over views of how much of a pixel a method hides: where drops are, and elsewhere.

    Args:
        views: of each, what the method hides, and what drops cover; [H, W], 0 to 1.
    """
    means = []
    for hidden, cover in views:
        drops = cover > COVERED
        means.append((hidden[drops].mean() if drops.any() else np.nan, hidden[~drops].mean()))
    within, between = np.nanmean(means, axis=0)
    return {"in drops": round(float(within), 2), "elsewhere": round(float(between), 2)}
