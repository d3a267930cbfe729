"""How hard a pattern is: its strength is set so that plain 3DGS should lose about as much as its grade says.

What 3DGS makes of rain can be told beforehand, roughly:

* Streaks are new in every view, and what many views agree on is a value between their mean and their median (the
  loss is an absolute error with a share of SSIM): the scene is learned too bright by S (beta - B), with S that
  value of the cover. Where few views see a place, single streaks are learned as well. The mean square of both is
  the streaks' harm.
* Water on the lens is at the same place in every view. A veil of mist is learned as part of the scene. Sharp drops
  cover other places of the scene in other views: of the error they make, one c-th is left where c views see a place.
* A scene is learned from clean views with an error in proportion to its fine detail; where that ratio has been
  measured, it is used. The loss in dB is 10 log10(1 + harm / error).

The loss that was really measured stands in the data card of each built scene, which is where a grade is judged.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hydroviews.rain.lens.mist import mist_veil
from hydroviews.rain.lens.pattern import RaindropPattern
from hydroviews.rain.scene_statistics import SceneStatistics
from hydroviews.rain.seeds import generator
from hydroviews.rain.streaks.effect import StreakPattern, streak_layer
from hydroviews.scene.images import to_linear, to_srgb

LOSS = {  # dB that plain 3DGS should lose against clean views, as predicted here
    "streak": {"light": 1.5, "medium": 4.0, "heavy": 8.5},
    "raindrop": {"light": 1.5, "medium": 3.7, "heavy": 8.5},  # medium drops cost 4 to 5 where 4 were predicted
}
FEWEST, MOST = 20.0, 300.0  # streak noise level n; the paper draws from 100 to 300
BRIGHTEST = 1.0  # a streak's encoded value, where n alone cannot reach the grade
TRIAL_VIEWS = 3  # whose mean cover stands for all
STEPS = 12  # of a bisection
LEARNED = 1.5  # mean squared error of a scene learned from clean views, in units of its fine detail, if not known
THICKEST_MIST = 0.95
TO_MEDIAN = 0.3  # how far from the mean to the median what many views agree on lies
LEFT = 1.7  # of the mean squared cover by streaks, times the scene's rarity: what is learned of single streaks


def wanted_harm(effect: str, grade: str, setting: SceneStatistics) -> float:
    """Mean squared error, in encoded values, that a pattern of this grade should leave in what is learned."""
    return float((setting.clean_error or LEARNED) * setting.detail * (10 ** (LOSS[effect][grade] / 10) - 1))


def grade_streaks(drawn: StreakPattern, grade: str, setting: SceneStatistics) -> StreakPattern:
    """The pattern with n, and if need be its brightness, set to the grade on this scene."""
    wanted = wanted_harm("streak", grade, setting)
    camera = setting.views[0].camera

    def cover(n: float) -> float:
        rngs = [generator(setting.seed, setting.scene, "trial", i) for i in range(TRIAL_VIEWS)]
        pattern = replace(drawn, n=n)
        layers = np.stack([streak_layer(pattern, camera.width, camera.height, rng) for rng in rngs])
        return learned_cover(layers, setting.mean_inverse_visibility)

    brightness, contrast = drawn.brightness, mean_squared_contrast(setting, drawn.brightness)
    n = solve(lambda value: cover(value) * contrast, wanted, FEWEST, MOST)
    if n == MOST:
        most = cover(MOST)
        brightness = solve(lambda v: most * mean_squared_contrast(setting, v), wanted, brightness, BRIGHTEST)
    return replace(drawn, n=round(n), brightness=round(brightness, 3))


def grade_raindrops(drawn: RaindropPattern, grade: str, setting: SceneStatistics) -> RaindropPattern:
    """The pattern with its mist, and if need be its coverage, set to the grade on this scene."""
    wanted = wanted_harm("raindrop", grade, setting)
    a_share = drops_harm(1.0, setting)
    coverage = min(drawn.coverage, wanted / a_share if a_share else 1.0)
    left = wanted - drops_harm(coverage, setting)
    mist = solve(veil_harm(drawn, setting), left, 0.0, THICKEST_MIST)
    return replace(drawn, coverage=round(coverage, 4), mist=round(mist, 4))


def veil_harm(pattern: RaindropPattern, setting: SceneStatistics) -> Callable[[float], float]:
    """For a level of mist, the mean squared difference that it makes to the scene, in encoded values."""
    air = (np.array(pattern.air) * setting.light.air).astype(np.float32)
    forms: dict[tuple[int, int], NDArray[np.float32]] = {}
    scenes = []
    for sample in setting.samples:
        height, width = sample.shape[:2]
        if (height, width) not in forms:
            forms[height, width] = mist_veil(replace(pattern, mist=1.0), width, height, moment=0.5)
        scenes.append((sample, to_linear(sample), forms[height, width][..., None]))

    def harm(level: float) -> float:
        veiled = [to_srgb(linear * (1 - level * form) + level * form * air) for _, linear, form in scenes]
        return float(np.mean([np.mean((v - sample) ** 2) for v, (sample, _, _) in zip(veiled, scenes, strict=True)]))

    return harm


def drops_harm(coverage: float, setting: SceneStatistics) -> float:
    """Mean squared error that sharp drops leave in what is learned, in encoded values.

    They show another place than the one they cover, and so err by twice the variance of the views; what is learned
    from c views errs by one c-th of that, and in scenes with large smooth surfaces by more, where it was measured.
    """
    return (
        setting.drops_cost
        * coverage
        * setting.mean_inverse_visibility
        * 2
        * float(np.mean([sample.var(axis=(0, 1)).mean(dtype=np.float64) for sample in setting.samples]))
    )


def learned_cover(layers: NDArray[np.float32], mean_inverse_visibility: float) -> float:
    """Mean square of the cover that a scene is learned to have under layers S [N, H, W] of fresh streaks."""
    agreed = (1 - TO_MEDIAN) * layers.mean(dtype=np.float64) + TO_MEDIAN * np.median(layers)
    return float(agreed**2 + LEFT * mean_inverse_visibility * np.mean(layers**2, dtype=np.float64))


def mean_squared_contrast(setting: SceneStatistics, brightness: float) -> float:
    """Mean of (beta - B)^2 over the scene, in encoded values."""
    return float(np.mean([np.mean((brightness - sample) ** 2) for sample in setting.samples]))


def solve(increasing: Callable[[float], float], wanted: float, low: float, high: float) -> float:
    """Where a function that grows from `low` to `high` takes the wanted value, or the end nearest to that."""
    if increasing(high) <= wanted:
        return high
    if increasing(low) >= wanted:
        return low
    for _ in range(STEPS):
        middle = (low + high) / 2
        low, high = (middle, high) if increasing(middle) < wanted else (low, middle)
    return (low + high) / 2
