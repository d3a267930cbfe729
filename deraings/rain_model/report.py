"""What a rain model and masks have found, for a run's record."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from deraings.masks.occlusion_masks import OcclusionMasks
from deraings.rain_model.model import RainModel
from deraings.rain_model.rain_layer import MIN_ALPHA

NEEDED_FROM = {"mist_mean": 0.0, "drops": 0.0, "renewed": 0.0, "rain": MIN_ALPHA, "streaks": 0.0, "masks": 0.0}


def report(model: RainModel, masks: OcclusionMasks | None, views: Mapping[int, tuple[int, int]]) -> dict[str, Any]:
    """What was found; of what differs from view to view, the largest of some views, each with its (height, width).

    Returns:
        `needed`: which of mist, drops, renewed drops, rain, streaks and masks were called for. Then numbers of each
        part that was looked for: `mist_mean` and `mist_max` of mist_alpha, `mist_r`, `mist_g`, `mist_b` of its linear
        light, `mist_seen` (mist_alpha as the network has it), `mist_removed` (share of the possible
        mist that the network takes away), `fog` (contrast lost over the median depth), `drops`
        (share of the lens more than half covered), `drops_seen` (the same as the network has it), `renewed` (share of
        pixels behind drops that are new in every view),
        `rain` (S), `rain_certainty`, `rain_angle` in degrees, `streaks` (mean |D|), `masks` (their mean).
    """
    numbers: dict[str, Any] = {}
    if model.mist:
        alphas = [model.mist_alpha(view, size) for view, size in views.items()]
        numbers |= {"mist_mean": max(a.mean() for a in alphas), "mist_max": max(a.max() for a in alphas)}
        numbers |= {f"mist_{channel}": light for channel, light in zip("rgb", model.mist.colour, strict=True)}
        if model.mist.seen is not None:
            numbers["mist_seen"] = model.mist.seen
        if model.enhanced is not None:
            numbers["mist_removed"] = model.enhanced.removed
        if model.mist.paleness is not None:
            numbers["fog"] = model.mist.paleness.fog
    if model.drops:
        numbers["drops"] = max((model.drop_alpha(view, size) > 0.5).mean() for view, size in views.items())
    if model.staying and model.staying.wanted:
        numbers["drops_seen"] = max((model.staying.hidden(view) > 0.5).mean() for view in views)
    if model.renewed and model.renewed.wanted:
        numbers["renewed"] = model.renewed.share
    if model.rain:
        numbers |= {"rain": model.even_alpha, "rain_certainty": model.rain.layer.certainty()}
        numbers["rain_angle"] = model.rain.layer.angle()
        if model.rain.streaks:
            numbers["streaks"] = max(np.abs(model.rain.streaks.deviation(view)).mean() for view in views)
    if masks:
        numbers["masks"] = masks.report()["mask_mean"]
    rounded = {name: round(float(value), 4) for name, value in numbers.items()}
    needed = [name.removesuffix("_mean") for name, limit in NEEDED_FROM.items() if rounded.get(name, 0) > limit]
    return {"needed": needed, **rounded}
