"""How many streaks a grade needs on a scene.

Streaks are new in every view, and what many views agree on is a value between their mean and their median (the loss is
an absolute error with a share of SSIM): the scene is learned too bright by S (beta - B), with S that value of the
cover. Where few views see a place, single streaks are learned as well. The mean square of both is the streaks' harm.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hydroviews.rain.scene_statistics import SceneStatistics
from hydroviews.rain.severity import solve, wanted_harm
from hydroviews.rain.streaks.recipe import StreakPattern, streak_layer
from hydroviews.scene.seeds import generator

LOSS = {"light": 1.5, "medium": 4.0, "heavy": 8.5}  # dB that plain 3DGS should lose against clean views
FEWEST, MOST = 20.0, 300.0  # streak noise level n; the paper draws from 100 to 300
BRIGHTEST = 1.0  # a streak's encoded value, where n alone cannot reach the grade
TRIAL_VIEWS = 3  # whose mean cover stands for all
TO_MEDIAN = 0.3  # how far from the mean to the median what many views agree on lies
SINGLE_STREAKS = 1.7  # of the mean squared cover, times the mean inverse visibility: what is learned of them


def grade_streaks(drawn: StreakPattern, grade: str, statistics: SceneStatistics) -> StreakPattern:
    """The pattern with n, and if need be its brightness, set to the grade on this scene."""
    wanted = wanted_harm(LOSS[grade], statistics)
    camera = statistics.views[0].camera

    def cover(n: float) -> float:
        rngs = [generator(statistics.seed, statistics.scene, "trial", i) for i in range(TRIAL_VIEWS)]
        pattern = replace(drawn, n=n)
        layers = np.stack([streak_layer(pattern, camera.width, camera.height, rng) for rng in rngs])
        return learned_cover(layers, statistics.mean_inverse_visibility)

    brightness, contrast = drawn.brightness, mean_squared_contrast(statistics, drawn.brightness)
    n = solve(lambda value: cover(value) * contrast, wanted, FEWEST, MOST)
    if n == MOST:
        most = cover(MOST)
        brightness = solve(lambda v: most * mean_squared_contrast(statistics, v), wanted, brightness, BRIGHTEST)
    return replace(drawn, n=round(n), brightness=round(brightness, 3))


def learned_cover(layers: NDArray[np.float32], mean_inverse_visibility: float) -> float:
    """Mean square of the cover that a scene is learned to have under layers S [N, H, W] of fresh streaks."""
    agreed = (1 - TO_MEDIAN) * layers.mean(dtype=np.float64) + TO_MEDIAN * np.median(layers)
    return float(agreed**2 + SINGLE_STREAKS * mean_inverse_visibility * np.mean(layers**2, dtype=np.float64))


def mean_squared_contrast(statistics: SceneStatistics, brightness: float) -> float:
    """Mean of (beta - B)^2 over the scene, in encoded values."""
    return float(np.mean([np.mean((brightness - sample) ** 2) for sample in statistics.samples]))
