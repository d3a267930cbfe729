"""How strong weather has to be for its grade.

Haze and darkness are the same in all views, so they are learned as part of the scene: the harm is the mean squared
difference that they make to the views. Of a shower each layer does its share of the harm, one after another in the
order of the light's way: a layer is as strong as brings the harm of all so far to the sum of their shares.
"""

from collections.abc import Callable, Iterable, Sequence
from math import exp, log

import numpy as np

from hydroviews.rain.severity import solve
from hydroviews.scene.images import Image

LOSS = {  # dB that plain 3DGS should lose against clean views; light and medium nights are dusk
    "haze": {"light": 1.5, "medium": 4.0, "heavy": 8.5},
    "dark": {"light": 1.5, "medium": 4.0, "heavy": 8.5},
    "night": {"light": 1.5, "medium": 4.0, "heavy": 16.0},
    "shower": {"light": 1.1, "medium": 3.3, "heavy": 8.0},  # costs 4.8 and 9.3 where 4.0 and 8.5 were predicted
}
SHARES = {"ambient": 0.15, "haze": 0.25, "storm": 0.2, "drops": 0.25, "mist": 0.15}  # of a shower's harm
DARKEST = 9.0  # stops


def harm(seen: Iterable[Image], clean: Sequence[Image]) -> float:
    """Mean squared difference, in encoded values, of views [H, W, 3] to clean ones."""
    return float(np.mean([np.mean((s - c) ** 2, dtype=np.float64) for s, c in zip(seen, clean, strict=True)]))


def solve_stops(increasing: Callable[[float], float], wanted: float) -> float:
    """How many stops of darkness do the wanted harm."""
    return round(solve(increasing, wanted, 0.0, DARKEST), 3)


def solve_ratio(increasing: Callable[[float], float], wanted: float, low: float, high: float) -> float:
    """As `solve`, in steps of equal ratio, for what ranges over powers of ten."""
    return float(f"{exp(solve(lambda u: increasing(exp(u)), wanted, log(low), log(high))):.4g}")
