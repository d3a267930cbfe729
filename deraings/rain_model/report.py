"""What rain an objective has found, for the record."""

from typing import TYPE_CHECKING, Any

import numpy as np

from deraings.rain_model.rain_layer import THIN

if TYPE_CHECKING:
    from deraings.rain_model.objective import RainObjective


def found(objective: "RainObjective") -> dict[str, Any]:
    """What was found, at the middle of the film.

    Returns:
        `needed`: which of veil, drops, falling, streaks and masks were called for; then means and maxima of what they
        are, `drops` being the share of the lens more than half covered. A part that is not looked for is left out.
    """
    middle = len(objective.images) // 2
    size = objective.images.pixels(middle).shape[0], objective.images.pixels(middle).shape[1]
    report: dict[str, Any] = {}
    if objective.veil:
        share = objective.veil_share(middle, size)
        report |= {"veil_mean": share.mean(), "veil_most": share.max()}
        report |= {f"veil_{channel}": light for channel, light in zip("rgb", objective.veil.colour, strict=True)}
        if objective.veil.evidence is not None:
            report["fog"] = objective.veil.evidence.fog
    if objective.drops:
        report["drops"] = (objective.drop_cover(middle, size) > 0.5).mean()
    if objective.falling:
        report |= {"falling": objective.cover, "falling_certainty": objective.falling.certainty()}
        report["falling_angle"] = objective.falling.angle()
    if objective.streaks:
        report["streaks"] = np.abs(objective.streaks.deviation(middle)).mean()
    if objective.masks:
        report["masks"] = objective.masks.found()["mask_mean"]
    limits = {"veil_mean": 0.0, "drops": 0.0, "falling": THIN, "streaks": 0.0, "masks": 0.0}
    numbers = {name: round(float(value), 4) for name, value in report.items()}
    needed = [name.removesuffix("_mean") for name, limit in limits.items() if numbers.get(name, 0) > limit]
    return {"needed": needed, **numbers}
