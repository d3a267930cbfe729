"""How sure a mean or a difference is: hierarchical bootstrap, signed ranks, Holm's correction, seeds that are needed.

The unit is a held-out view of a scene under a pattern, rendered by a run with a seed. Runs of a scene share its views.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

LEVEL = 0.95  # of intervals
SIGNIFICANT = 1 - LEVEL  # p below it
POWER = 0.8  # with which `seeds_needed` would find a difference
DRAWS = 10_000
LEAST_SCENES = 4  # for an interval on the board: of fewer, Student's t makes one that says nothing


@dataclass(frozen=True)
class SceneScores:
    """Scores of all runs on one scene that are compared."""

    values: NDArray[np.float64]  # [runs, views, M]: M methods, or differences between them
    patterns: NDArray[np.int64]  # [runs], a number for each pattern

    def run_weights(self) -> NDArray[np.float64]:
        """What each run counts in the scene's mean [runs]: patterns alike, and the seeds of a pattern alike."""
        _, index, counts = np.unique(self.patterns, return_inverse=True, return_counts=True)
        return np.asarray(1 / (len(counts) * counts[index]))

    def mean(self) -> NDArray[np.float64]:
        """Over views, seeds and patterns, [M]."""
        return np.asarray(self.run_weights() @ self.values.mean(axis=1))

    def draw(self, draws: int, rng: np.random.Generator) -> NDArray[np.float64]:
        """Means [draws, M] over views and seeds that are drawn with replacement; all patterns stay."""
        n_runs, n_views, n_methods = self.values.shape
        views = rng.multinomial(n_views, np.full(n_views, 1 / n_views), draws) / n_views
        runs = np.empty((draws, n_runs))
        for pattern in np.unique(self.patterns):
            seeds = np.flatnonzero(self.patterns == pattern)
            runs[:, seeds] = rng.multinomial(len(seeds), np.full(len(seeds), 1 / len(seeds)), draws)
        weights = (runs * self.run_weights())[:, :, None] * views[:, None, :]
        return np.asarray(weights.reshape(draws, -1) @ self.values.reshape(-1, n_methods))


@dataclass(frozen=True)
class Estimate:
    """Means [M], scenes alike, with the bounds of their intervals; NaN where there is one unit to draw from."""

    mean: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]


def estimate(scenes: Sequence[SceneScores], seed: int = 0, draws: int = DRAWS) -> Estimate:
    """Means over scenes with intervals of LEVEL by a hierarchical bootstrap: scenes, then views and seeds.

    Scenes are drawn with replacement, and what lies below them is kept as it is: its spread is in that of the scenes
    already, and drawing it again would count it twice (Davison and Hinkley 1997, "Bootstrap methods and their
    application", 3.8). Of a single scene, views and seeds are drawn, and the interval is of that scene alone.

    As few are drawn from, an interval is Student's t (of one less than there are scenes, or views of a single one)
    times the bootstrap's standard error, widened by sqrt(n / (n - 1)) for the spread that n drawn of n lack (Hesterberg
    2015, "What teachers should know about the bootstrap").
    """
    rng = np.random.default_rng(seed)
    means = np.stack([scene.mean() for scene in scenes])
    if len(scenes) > 1:
        n = len(scenes)
        drawn = rng.multinomial(n, np.full(n, 1 / n), draws) / n @ means
    else:
        n, drawn = scenes[0].values.shape[1], scenes[0].draw(draws, rng)
    mean = means.mean(axis=0)
    if n < 2:
        return Estimate(mean, np.full_like(mean, np.nan), np.full_like(mean, np.nan))
    from scipy import stats

    half = stats.t.ppf((1 + LEVEL) / 2, n - 1) * drawn.std(axis=0) * math.sqrt(n / (n - 1))
    return Estimate(mean, mean - half, mean + half)


def signed_rank_p(scenes: Sequence[SceneScores]) -> NDArray[np.float64]:
    """p of Wilcoxon's signed-rank test [M], two-sided: do two methods differ on these scenes and patterns?

    Args:
        scenes: values are differences. A run counts once, with the mean over its views: all of them were rendered by
            one training, whose luck they share.
    """
    runs = np.concatenate([scene.values.mean(axis=1) for scene in scenes])
    p = np.ones(runs.shape[1])
    some = np.any(runs != 0, axis=0)  # equal everywhere: nothing to rank
    if some.any():
        from scipy import stats

        p[some] = stats.wilcoxon(runs[:, some], axis=0).pvalue
    return p


def holm(p: NDArray[np.float64]) -> NDArray[np.float64]:
    """p-values of several tests, corrected so that chance brings any of them below a level as rarely (Holm 1979)."""
    order = np.argsort(p)
    corrected = np.empty(len(p))
    corrected[order] = np.minimum(np.maximum.accumulate((len(p) - np.arange(len(p))) * p[order]), 1)
    return corrected


def seeds_needed(scenes: Sequence[SceneScores]) -> float:
    """Seeds a pattern with which a difference as large as the one found would be told from 0, in POWER of all cases.

    On these scenes and patterns, by the spread between seeds (normal approximation).

    Args:
        scenes: values are of one difference, M = 1.

    Returns:
        A whole number; infinity for no difference; NaN where no pattern has two seeds to tell their spread.
    """
    groups = [
        scene.values[scene.patterns == pattern].mean(axis=(1, 2))
        for scene in scenes
        for pattern in np.unique(scene.patterns)
    ]
    freedom = sum(len(group) - 1 for group in groups)
    if not freedom:
        return math.nan
    variance = sum(((group - group.mean()) ** 2).sum() for group in groups) / freedom
    difference = np.mean([scene.mean() for scene in scenes])
    if difference == 0:
        return math.inf
    from scipy import stats

    factor = stats.norm.ppf((1 + LEVEL) / 2) + stats.norm.ppf(POWER)
    return max(1.0, math.ceil(factor**2 * variance / difference**2 / len(groups)))
