"""Means over the runs that all compared methods have, and the order of methods by them."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from hydroviews.dataset.clean_views import CLEAN
from hydroviews.metrics import Metric, find_metrics
from leaderboard.records import SCORED

RUN = ["scene", "pattern", "seed", "data_sha256"]  # what runs of two methods have to agree in
ENOUGH = 0.5  # of the runs that methods with more of them share; who lacks more would leave the others little
COSTS = ("train_s", "before_s", "after_s", "render_fps", "peak_mem_mb", "peak_gpu_mem_mb", "model_mb", "n_primitives")


def shown_names(rows: pd.DataFrame) -> pd.Series:
    """Methods as tables name them: what somebody submitted is marked."""
    return rows.method + rows.submitted_by.map(lambda by: " (submitted)" if by and pd.notna(by) else "")


@dataclass(frozen=True)
class Compared:
    """The methods of a table that are compared with each other, and what they are compared on."""

    methods: list[str]
    apart: list[str]  # have runs, and too few of those that the others share
    runs: set[tuple[Any, ...]]  # what all compared methods have, as RUN
    rows: pd.DataFrame  # these runs of the compared methods, and those on clean views with their scenes and seeds


def shared_runs(runs: Mapping[str, set[Any]], least: float = ENOUGH) -> tuple[list[str], set[Any]]:
    """The methods that can be compared, and the runs that all of these have.

    Methods join in the order of how many runs they have; one that has none, or a smaller share than `least` of what
    those before it share, stays out.
    """
    compared: list[str] = []
    common: set[Any] = set()
    for name in sorted(runs, key=lambda name: (-len(runs[name]), name)):
        shared = runs[name] & common if compared else runs[name]
        if shared and len(shared) >= least * len(common):
            compared.append(name)
            common = shared
    return compared, common


def compared_runs(rows: pd.DataFrame, least: float = ENOUGH) -> Compared:
    """Which scored runs of a table are compared: whatever is said of several methods is said of these.

    Methods that learn from clean views are references and are not compared. Their runs are those of the scenes and
    seeds that are, so that they stand for the same scenes; all of them where nothing is compared.

    Args:
        rows: runs as `gather.collect` has them, with methods as tables name them.
        least: see `shared_runs`.
    """
    done = rows[rows.status.isin(SCORED)]
    clean = done.pattern == CLEAN
    own = {str(name): set(map(tuple, group[RUN].to_numpy())) for name, group in done[~clean].groupby("method")}
    methods, common = shared_runs(own, least)
    seeds = {(scene, seed) for scene, _, seed, _ in common}
    shared = np.array([tuple(run) in common for run in done[RUN].to_numpy()], bool) & done.method.isin(methods)
    beside = np.array([not common or run in seeds for run in zip(done.scene, done.seed, strict=True)], bool)
    kept = done[np.where(clean, beside, shared)]
    return Compared(methods, sorted(set(own) - set(methods)), common, kept)


@dataclass(frozen=True)
class Block:
    """Runs that tables and comparisons are made of."""

    rows: pd.DataFrame  # as `gather.collect` has them, with methods as tables name them
    shared_runs: str  # in words, where these are only the runs that all methods have; else empty


def blocks(rows: pd.DataFrame) -> list[Block]:
    """What is told of some runs: first all of them; where that leaves out methods, then all methods on what they share.

    In the second block methods are ranked among themselves, as no one lacks a run of it. One that shares no run with
    the others is not in it.
    """
    first = Block(rows, "")
    found = compared_runs(rows)
    shared = compared_runs(rows, least=0) if found.apart else found
    return [first, Block(shared.rows, _runs_text(shared.runs))] if len(shared.methods) > len(found.methods) else [first]


def _runs_text(runs: set[tuple[Any, ...]]) -> str:
    scenes, patterns, seeds = (sorted({run[i] for run in runs}) for i in range(3))
    plural = "s" if len(seeds) > 1 else ""
    return f"{', '.join(scenes)}; {', '.join(patterns)}; seed{plural} {', '.join(map(str, seeds))}"


def method_means(rows: pd.DataFrame, kept: pd.DataFrame | None = None) -> pd.DataFrame:
    """Means of some runs: a row a method.

    A mean weighs scenes alike, in a scene its patterns, in a pattern its seeds. A number that one of the runs lacks
    is NaN.

    Args:
        rows: runs as `gather.collect` has them, with methods as tables name them.
        kept: those that means are taken over, if they are known already: see `compared_runs`.

    Returns:
        Columns: one a metric, those of COSTS, `finished` and `planned` (runs), `compared` (runs that the means are
        over), `reference` (learns from clean views).
    """
    kept = compared_runs(rows).rows if kept is None else kept
    names = [*(metric.name for metric in find_metrics()), *COSTS]
    numbers = kept[["method", "scene", "pattern", *names]].astype(dict.fromkeys(names, "float64"))
    for keys in (["method", "scene", "pattern"], ["method", "scene"], ["method"]):
        if numbers.duplicated(keys).any():
            numbers = numbers.groupby(keys)[names].mean(skipna=False).reset_index()
    means = numbers.set_index("method")[names].reindex(sorted(set(rows.method)))
    clean = rows.pattern == CLEAN
    own = rows.method.value_counts()
    means["finished"] = rows[rows.status.isin(SCORED)].method.value_counts().reindex(means.index, fill_value=0)
    means["reference"] = ~means.index.isin(rows[~clean].method)
    asked = len(rows.loc[~clean, ["scene", "pattern", "seed"]].drop_duplicates())
    means["planned"] = own.reindex(means.index).where(means.reference, asked)
    means["compared"] = kept.method.value_counts().reindex(means.index, fill_value=0)
    return means


def places(means: pd.DataFrame, metric: Metric) -> dict[str, int]:
    """The place of each method by a metric, 1 the best, without references and methods that have no number.

    One more than the number of methods that finished more runs, or as many and have a better mean.
    """
    judged = means[~means.reference.astype(bool) & means[metric.name].notna()]
    value = judged[metric.name].to_numpy(float) * (1 if metric.higher_is_better else -1)
    finished = judged.finished.to_numpy(float)
    more = finished > finished[:, None]
    better = (finished == finished[:, None]) & (value > value[:, None])
    return dict(zip(map(str, judged.index), 1 + (more | better).sum(axis=1), strict=True))


def incomplete(row: Mapping[Any, Any]) -> bool:
    """Whether a method lacks runs that were asked of it."""
    return bool(row["finished"] < row["planned"])
