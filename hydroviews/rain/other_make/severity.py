"""How strong the other make's rain must be for a grade: harm as `rain.severity` has it, of what is really drawn.

Mist and a veil stay where they are and are learned as part of the scene: their harm is mean((k (c - B))^2). Drops and
streaks lie elsewhere in every view: of their squared error a share is left, which is the mean inverse number of views
that see a place, times a constant.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hydroviews.rain.other_make.drops import LensPattern, drops_on
from hydroviews.rain.other_make.lens import map_lens, see_through
from hydroviews.rain.other_make.mist import mist_cover
from hydroviews.rain.other_make.rainfall import MOST, RainfallPattern, draw_rainfall, rain_over, sky_colour, veil_cover
from hydroviews.rain.scene_statistics import SceneStatistics
from hydroviews.rain.severity import MOST_BY_DROPS, solve, wanted_harm
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import Image
from hydroviews.scene.seeds import generator

LOSS = {  # dB that plain 3DGS should lose against clean views
    "raindrop-b": {"light": 1.5, "medium": 3.7, "heavy": 8.5},
    "streak-b": {"light": 1.9, "medium": 4.0, "heavy": 7.8},
}
DROPS_LEFT = 1.0  # of the drops' squared error, times the mean inverse visibility: what is learned of them
STREAKS_LEFT = 9.0  # the same of streaks, which Gaussians learn before single views: more than a mean would keep
STREAKS_SHIFT = 0.7  # of the squared change that streaks' mean cover and the veil make: what is learned of that
THICKEST_MIST = 0.95
VEIL = {"light": 0.04, "medium": 0.1, "heavy": 0.2}  # cover by the veil when there are MOST strokes
TRIALS = 8  # of the samples, at most, that it rains on to find how many strokes a grade takes
OPAQUE = 0.9  # a stroke's mean cover, where their number alone cannot reach the grade


def grade_lens(drawn: LensPattern, grade: str, statistics: SceneStatistics) -> LensPattern:
    """The pattern with its mist, and if need be its coverage, set to the grade on this scene."""
    wanted = wanted_harm(LOSS["raindrop-b"][grade], statistics)
    most = drops_harm(drawn, statistics)
    coverage = drawn.coverage * min(1.0, MOST_BY_DROPS * wanted / most if most else 1.0)
    fewer = replace(drawn, coverage=round(coverage, 4))
    left = wanted - drops_harm(fewer, statistics)
    forms = [mist_cover(replace(fewer, mist=1.0), *_size(sample), 0.5)[..., None] for sample in statistics.samples]
    colour = np.array(drawn.mist_colour, np.float32)
    # Mist grows in proportion to its level, and its harm with the square of that.
    whole = float(np.mean([_squared(k * (colour - b)) for k, b in zip(forms, statistics.samples, strict=True)]))
    mist = np.sqrt(max(left, 0.0) / whole) if whole else THICKEST_MIST
    return replace(fewer, mist=round(float(min(mist, THICKEST_MIST)), 4))


def drops_harm(pattern: LensPattern, statistics: SceneStatistics) -> float:
    """Mean squared error that drops leave in what is learned, in encoded values."""
    errors, maps = [], {}
    for sample in statistics.samples:
        size = _size(sample)
        if size not in maps:
            maps[size] = map_lens(pattern, drops_on(pattern, *size, 0.5), statistics.views[0].camera.resized(*size))
        cover, light = see_through(maps[size], sample, pattern)
        errors.append(_squared(light - cover[..., None] * sample))
    return DROPS_LEFT * statistics.drops_cost * statistics.mean_inverse_visibility * float(np.mean(errors))


def grade_rainfall(
    drawn: RainfallPattern, grade: str, statistics: SceneStatistics, falls: Sequence[NDArray]
) -> RainfallPattern:
    """The pattern with strokes and veil, and if need be opacity, set to the grade.

    Args:
        drawn: the pattern.
        grade: its name.
        statistics: the scene.
        falls: for every sample, the direction [3] of the fall in its camera's axes.
    """
    wanted = wanted_harm(LOSS["streak-b"][grade], statistics)

    def with_strength(share: float) -> RainfallPattern:
        return replace(drawn, strokes=round(MOST * share), veil=round(VEIL[grade] * share, 4))

    share = solve(lambda s: rainfall_harm(with_strength(s), statistics, falls), wanted, 0.0, 1.0)
    graded = with_strength(share)
    if share == 1.0:
        opacity = solve(
            lambda o: rainfall_harm(replace(graded, opacity=o), statistics, falls), wanted, drawn.opacity, OPAQUE
        )
        graded = replace(graded, opacity=round(opacity, 4))
    return graded


def rainfall_harm(pattern: RainfallPattern, statistics: SceneStatistics, falls: Sequence[NDArray]) -> float:
    """Mean squared error that streaks and veil leave in what is learned: their mean shift, and what is left of each."""
    camera, shifts, singles = statistics.views[0].camera, [], []
    pairs = list(zip(statistics.samples, falls, strict=True))
    for i, (sample, fall) in enumerate(pairs[:: -(-len(pairs) // TRIALS)]):
        small: Camera = camera.resized(*_size(sample))
        rng = generator(statistics.seed, statistics.scene, "trial", i)
        streaks = draw_rainfall(pattern, small, fall, rng)
        veil, sky = veil_cover(pattern, *_size(sample)), sky_colour(sample)
        mean = rain_over(sample, np.full_like(streaks, streaks.mean()), veil, pattern.screen, sky)
        one = rain_over(sample, streaks, veil, pattern.screen, sky)
        shifts.append(_squared(mean - sample))
        singles.append(_squared(one - mean))
    left = STREAKS_LEFT * statistics.mean_inverse_visibility
    return float(STREAKS_SHIFT * np.mean(shifts) + left * np.mean(singles))


def _size(sample: Image) -> tuple[int, int]:
    return sample.shape[1], sample.shape[0]


def _squared(error: NDArray[np.float32]) -> float:
    return float(np.mean(error**2, dtype=np.float64))
