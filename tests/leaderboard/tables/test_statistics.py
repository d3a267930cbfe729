"""Intervals hold the truth as often as they say, a difference of nothing is as rarely found, and closed forms."""

import math

import numpy as np
import pytest
from scipy import stats

from leaderboard.tables.statistics import SceneScores, estimate, holm, seeds_needed, signed_rank_p

BOARDS = 2000


def boards(scenes, views, patterns, seeds, spread, rng):
    """BOARDS differences of nothing at once, spread between scenes, views, runs and what is left."""
    of_scenes, of_views, of_runs, rest = spread
    runs = patterns * seeds
    found = []
    for _ in range(scenes):
        values = rng.normal(0, of_scenes, (1, 1, BOARDS)) + rng.normal(0, of_views, (1, views, BOARDS))
        values = values + rng.normal(0, of_runs, (runs, 1, BOARDS)) + rng.normal(0, rest, (runs, views, BOARDS))
        found.append(SceneScores(values, np.repeat(np.arange(patterns), seeds)))
    return found


@pytest.mark.parametrize(
    ("shape", "spread"),
    [
        ((5, 8, 6, 1), (0.5, 0.3, 0.2, 0.2)),  # as the test suite has it, one seed
        ((5, 8, 6, 3), (0.5, 0.3, 0.2, 0.2)),
        ((5, 8, 6, 1), (0.0, 0.3, 0.2, 0.2)),  # scenes that are alike
        ((5, 8, 6, 1), (0.0, 0.0, 0.2, 0.2)),  # and views
        ((2, 8, 2, 2), (0.5, 0.3, 0.2, 0.2)),
        ((1, 8, 6, 1), (0.0, 0.3, 0.0, 0.2)),  # of one scene, whose views are drawn
    ],
)
def test_intervals_of_95_percent_hold_the_truth_in_93_to_97(shape, spread):
    scenes = boards(*shape, spread, np.random.default_rng(7))
    found = estimate(scenes, draws=1000)
    holds = (found.low < 0) & (found.high > 0)
    assert 0.93 <= holds.mean() <= 0.97
    told_apart = (~holds & (signed_rank_p(scenes) < 0.05)).mean()
    assert told_apart <= 0.07
    assert told_apart >= 0.03 or not any(spread[:2])  # fewer where only the luck of training differs


@pytest.mark.parametrize("shape", [(5, 8, 6, 1), (5, 8, 6, 3), (3, 5, 6, 1)])
def test_a_difference_of_nothing_is_significant_in_3_to_7_percent(shape):
    """Also where all views of a run share its luck, of which a test on single views would find too much."""
    scenes = boards(*shape, (0.0, 0.0, 0.2, 0.2), np.random.default_rng(8))
    assert 0.03 <= (signed_rank_p(scenes) < 0.05).mean() <= 0.07
    views = np.concatenate([scene.values.reshape(-1, BOARDS) for scene in scenes])[:, :200]
    assert (stats.wilcoxon(views, axis=0).pvalue < 0.05).mean() > 0.2


def test_a_difference_is_found():
    scenes = boards(5, 8, 6, 1, (0.1, 0.3, 0.2, 0.2), np.random.default_rng(9))
    better = [SceneScores(scene.values + 0.5, scene.patterns) for scene in scenes]
    assert (signed_rank_p(better) < 0.05).mean() > 0.95
    assert (estimate(better).low > 0).mean() > 0.95


def test_means_weigh_scenes_patterns_seeds_and_views_alike():
    first = SceneScores(np.array([[1.0, 3.0], [5.0, 7.0], [10.0, 20.0]])[..., None], np.array([0, 0, 1]))
    second = SceneScores(np.array([[100.0]])[..., None], np.array([0]))
    assert first.mean()[0] == pytest.approx(((2 + 6) / 2 + 15) / 2)
    assert estimate([first, second]).mean[0] == pytest.approx((9.5 + 100) / 2)


def test_the_interval_over_scenes_is_students():
    rng = np.random.default_rng(3)
    values = rng.normal(20, 3, 6)
    found = estimate([SceneScores(np.full((2, 3, 1), value), np.array([0, 1])) for value in values], draws=200_000)
    low, high = stats.t.interval(0.95, 5, values.mean(), stats.sem(values))
    assert (found.low[0], found.high[0]) == pytest.approx((low, high), rel=2e-3)


def test_equal_methods_have_p_1():
    scenes = [SceneScores(np.tile([0.0, 1.0], (3, 2, 1)), np.zeros(3, int))] * 4
    equal, better = signed_rank_p(scenes)
    assert equal == 1
    assert better < 0.05


def test_holms_correction():
    assert holm(np.array([0.01, 0.04, 0.03])) == pytest.approx([0.03, 0.06, 0.06])
    assert holm(np.array([0.6, 0.9])) == pytest.approx([1, 1])
    assert holm(np.array([0.04])) == pytest.approx([0.04])


def test_so_many_seeds_find_a_difference_in_four_of_five_boards():
    rng = np.random.default_rng(5)
    luck = rng.normal(size=200)
    luck = 0.1 + 0.4 * (luck - luck.mean()) / luck.std(ddof=1)
    scenes = [SceneScores(np.tile(luck, 2)[:, None, None], np.repeat([0, 1], 200))] * 3
    seeds = seeds_needed(scenes)
    assert seeds == math.ceil((1.959964 + 0.841621) ** 2 * 0.4**2 / 0.1**2 / 6)
    trials = rng.normal(0.1, 0.4, (6 * int(seeds), 4000))
    assert (stats.ttest_1samp(trials, 0, axis=0).pvalue < 0.05).mean() == pytest.approx(0.8, abs=0.03)


def test_the_spread_of_two_seeds_is_that_of_a_sample():
    """Of 0 and 2 the variance is 2, not 1."""
    scene = SceneScores(np.array([0.0, 2.0])[:, None, None], np.zeros(2, int))
    assert seeds_needed([scene]) == math.ceil(2 * (1.959964 + 0.841621) ** 2)


def test_seeds_that_nothing_is_known_of():
    assert math.isnan(seeds_needed([SceneScores(np.ones((2, 3, 1)), np.array([0, 1]))]))
    assert math.isinf(seeds_needed([SceneScores(np.zeros((2, 3, 1)), np.array([0, 0]))]))
    assert seeds_needed([SceneScores(np.ones((2, 3, 1)), np.array([0, 0]))]) == 1
