"""How far what was found of the rain is from what was added: scores against the layers of a built variant.

For tests and tables alone; no method may look at layers.
"""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from deraings.image_planes import Plane
from deraings.rain_model.model import RainModel
from hydroviews.files.atomic import read_json
from hydroviews.rain.layers import read_layers
from hydroviews.rain.registry import find_effect
from hydroviews.scene.scenes import View

COVERED = 0.5  # drop_alpha from which a pixel counts as hidden
SHARES = {"drops": "water", "mist": "mist"}  # what the rain model finds, and what planes of layers count for


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
    effect = find_effect(read_json(variant / "pattern.json")["effect"])
    size = view.camera.width, view.camera.height
    layers = read_layers(variant / "layers" / f"{view.name}.exr")
    planes = {n: np.asarray(cv2.resize(p, size, interpolation=cv2.INTER_AREA), np.float32) for n, p in layers.items()}
    falling = {"rain": planes.pop(effect.falling)} if effect.falling else {}
    covers = effect.covers(planes)
    return {part: covers[share] for part, share in SHARES.items() if share in covers} | falling


def plane_errors(found: Plane, true: Plane) -> dict[str, float]:
    """Root mean square error, mean error and correlation of a plane [H, W]; correlation 0 where either is even.

    Raises:
        ValueError: the two differ in size.
    """
    if found.shape != true.shape:
        raise ValueError(f"planes {found.shape} and {true.shape} differ in size")
    error = found.astype(np.float64) - true
    even = found.std() == 0 or true.std() == 0
    correlation = 0.0 if even else float(np.corrcoef(found.ravel(), true.ravel())[0, 1])
    return {"rms": float(np.sqrt(np.mean(error**2))), "mean": float(error.mean()), "correlation": correlation}


def mask_scores(found: NDArray[np.bool_], true: NDArray[np.bool_]) -> dict[str, float]:
    """Intersection over union, precision and recall of a mask [H, W]; 1 where there is nothing to find or to miss.

    Raises:
        ValueError: the two differ in size.
    """
    if found.shape != true.shape:
        raise ValueError(f"masks {found.shape} and {true.shape} differ in size")
    both, either = int((found & true).sum()), int((found | true).sum())
    shares = {"iou": either, "precision": int(found.sum()), "recall": int(true.sum())}
    return {name: both / total if total else 1.0 for name, total in shares.items()}


def score_rain(model: RainModel, variant: Path, views: Sequence[View]) -> dict[str, float]:
    """Means over training views of what a model has found against the variant's layers.

    Args:
        model: after training on these views, in their order.
        variant: folder of the rainy variant.
        views: its training views.

    Returns:
        `rms`, `mean` and `correlation` of mist_alpha (`mist_rms`, ...) and of drop_alpha (`drops_rms`, ...),
        `drops_iou`, `drops_precision`, `drops_recall`, and `rain_even_error` (S less the true median rain_alpha), as
        far as the variant's effect has such.

    Raises:
        InputError: a layer is missing or unreadable.
    """
    scores: dict[str, list[float]] = {}
    for index, view in enumerate(views):
        for name, value in _score_view(model, index, true_covers(variant, view)).items():
            scores.setdefault(name, []).append(value)
    return {name: float(np.mean(values)) for name, values in scores.items()}


def _score_view(model: RainModel, index: int, true: dict[str, Plane]) -> dict[str, float]:
    """The same of one view, given its covers."""
    scores: dict[str, float] = {}
    height, width = next(iter(true.values())).shape
    if "mist" in true:
        scores |= _named("mist", plane_errors(model.mist_alpha(index, (height, width)), true["mist"]))
    if "drops" in true:
        alpha = model.drop_alpha(index, (height, width))
        masks = mask_scores(alpha > COVERED, true["drops"] > COVERED)
        scores |= _named("drops", masks | plane_errors(alpha, true["drops"]))
    if "rain" in true:
        scores["rain_even_error"] = model.even_alpha - float(np.median(true["rain"]))
    return scores


def _named(part: str, values: dict[str, float]) -> dict[str, float]:
    return {f"{part}_{name}": value for name, value in values.items()}
