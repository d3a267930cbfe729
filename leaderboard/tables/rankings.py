"""One table per rain and grade: every method that ran under it, on the scenes that it has.

Means are over seeds, then scenes. Means over different scenes cannot be compared, differences in pairs of runs can:
methods are ranked by their gain in PSNR over FLOOR. On the same scenes this is the order of their means.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from hydroviews.dataset.clean_views import CLEAN
from hydroviews.metrics import find_metrics
from hydroviews.rain.patterns import GRADES
from leaderboard.records import FLOOR, SCORED, effect_of
from leaderboard.tables.dataframes import grade_of
from leaderboard.tables.means import RUN
from leaderboard.tables.statistics import LEAST_SCENES, SceneScores, estimate

SECONDS = ("train_s", "before_s", "after_s")
PLACE = ("scene", "seed")  # what a run on clean views shares with those under rain
FIRST_GRADE = GRADES[1]  # medium, which most methods ran under


@dataclass(frozen=True)
class RankedMethod:
    """A method's row. Numbers that a run of it lacks are NaN."""

    method: str
    rank: int | None  # None for a reference, which learns from clean views
    tied: bool  # with the row above: the interval of their difference holds 0
    scenes: tuple[str, ...]
    runs: int
    scores: Mapping[str, float]  # by metric
    seconds: float  # before, in and after training
    gain: float  # in PSNR over FLOOR, in pairs of runs; NaN where there is no pair
    low: float  # its interval; NaN below LEAST_SCENES scenes
    high: float


@dataclass(frozen=True)
class Ranking:
    """All methods under a pattern: references, then methods by rank."""

    pattern: str
    title: str  # effect and grade
    scenes: tuple[str, ...]  # that any method has
    methods: tuple[RankedMethod, ...]

    @property
    def best(self) -> Mapping[str, float]:
        """The best value of each metric among methods with most scenes, without references."""
        judged = [one for one in self.methods if one.rank is not None]
        full = [one for one in judged if len(one.scenes) == max(len(other.scenes) for other in judged)]
        found = {}
        for metric in find_metrics():
            values = [value for one in full if not math.isnan(value := one.scores[metric.name])]
            if values:
                found[metric.name] = max(values) if metric.higher_is_better else min(values)
        return found


def rankings(rows: pd.DataFrame) -> list[Ranking]:
    """A ranking for every pattern of some runs, medium grades and patterns with many runs first.

    Args:
        rows: runs of one profile and track, as `gather.collect` has them, with methods as tables name them.
    """
    done = rows[rows.status.isin(SCORED)]
    runs = done.pattern.value_counts()
    rainy = sorted({*done.pattern} - {CLEAN}, key=lambda name: (grade_of(name) != FIRST_GRADE, -runs[name], name))
    return [_ranking(done, pattern) for pattern in rainy or ([CLEAN] if len(done) else [])]


def _ranking(done: pd.DataFrame, pattern: str) -> Ranking:
    own = done[done.pattern == pattern]
    clean = done[(done.pattern == CLEAN) & (pattern != CLEAN)]
    clean = clean[_index(clean, PLACE).isin(_index(own, PLACE))]
    floor = own[own.method == FLOOR]
    gains = pd.concat([_above(own, floor, RUN), _above(clean, floor, PLACE)])
    strength = (gains if len(floor) else _by_scene(own, own.psnr)).mean(axis=1)
    strength = strength.reindex(sorted(set(own.method))).fillna(-math.inf)
    order = [str(name) for name in strength.sort_values(ascending=False, kind="stable").index]
    ranks = strength.rank(ascending=False, method="min").astype(int).to_dict()
    ties = {name for above, name in pairwise(order) if _is_tie(own, above, name)}
    shown, both = [*sorted(set(clean.method)), *order], pd.concat([clean, own])
    methods = tuple(_row(name, both[both.method == name], ranks.get(name), gains, name in ties) for name in shown)
    title = ", ".join(filter(None, (effect_of(pattern), grade_of(pattern))))
    return Ranking(pattern, title, tuple(sorted(set(own.scene))), methods)


def _row(name: str, runs: pd.DataFrame, rank: int | None, gains: pd.DataFrame, tied: bool) -> RankedMethod:
    names = [*(metric.name for metric in find_metrics()), "seconds"]
    costs = runs[[*SECONDS]].astype(float)
    runs = runs.assign(seconds=costs.train_s + costs.before_s.fillna(0) + costs.after_s.fillna(0))
    means = {one: float(_by_scene(runs, runs[one]).mean(axis=1, skipna=False).iloc[0]) for one in names}
    seconds = means.pop("seconds")
    gain = _interval(gains.loc[name].dropna().to_numpy(float)) if name in gains.index else (math.nan,) * 3
    return RankedMethod(name, rank, tied, tuple(sorted(set(runs.scene))), len(runs), means, seconds, *gain)


def _index(rows: pd.DataFrame, columns: Sequence[str]) -> pd.MultiIndex:
    return pd.MultiIndex.from_frame(rows[[*columns]])


def _by_scene(rows: pd.DataFrame, values: pd.Series) -> pd.DataFrame:
    """Means over seeds: a row a method, a column a scene; NaN where there is no run or a number is missing."""
    means = values.astype(float).groupby([rows.method, rows.scene]).mean(skipna=False)
    return means.unstack() if len(means) else pd.DataFrame()


def _above(rows: pd.DataFrame, others: pd.DataFrame, keys: Sequence[str]) -> pd.DataFrame:
    """PSNR minus that of another method in runs that agree in some columns, as `_by_scene`."""
    pairs = rows.merge(others[[*keys, "psnr"]], on=[*keys], suffixes=("", "_other"))
    difference = pairs["psnr"].to_numpy(float) - pairs["psnr_other"].to_numpy(float)
    return _by_scene(pairs, pd.Series(difference, pairs.index))


def _is_tie(own: pd.DataFrame, above: str, name: str) -> bool:
    found = _above(own[own.method == name], own[own.method == above], RUN)
    _, low, high = _interval(found.to_numpy(float).ravel()) if len(found) else (math.nan,) * 3
    return low <= 0 <= high


def _interval(differences: NDArray[np.float64]) -> tuple[float, float, float]:
    """The mean over scenes and its interval, which is NaN below LEAST_SCENES scenes."""
    if len(differences) < LEAST_SCENES:
        return float(differences.mean()) if len(differences) else math.nan, math.nan, math.nan
    found = estimate([SceneScores(np.array([[[value]]]), np.zeros(1, np.int64)) for value in differences])
    return float(found.mean[0]), float(found.low[0]), float(found.high[0])
