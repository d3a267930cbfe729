"""Methods against each other on the runs that all of them have: means, differences, intervals, significance, ties.

Two methods are told apart only where the signed ranks say that they differ on these scenes, and the interval of their
difference, which is of scenes like these, does not hold 0.
"""

import math
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd

from hydroviews.dataset.clean_views import CLEAN
from hydroviews.errors import InputError, unknown_name
from hydroviews.formats.tables.markdown import markdown_table
from hydroviews.metrics import Metric, find_metrics
from leaderboard.tables.means import ENOUGH, RUN, compared_runs, shown_names
from leaderboard.tables.statistics import SIGNIFICANT, SceneScores, estimate, holm, seeds_needed, signed_rank_p


@dataclass(frozen=True)
class Comparison:
    """Methods on the same runs."""

    metric: Metric
    methods: pd.DataFrame  # method, rank, finished, planned, mean, low, high; best first
    pairs: pd.DataFrame  # first, second, difference (first minus second), low, high, p, p_holm, significant
    n_scenes: int
    n_runs: int  # of each method that are compared
    n_views: int  # in all of these
    seeds: float  # a pattern, that would tell the first two apart; NaN if unknown, see `seeds_needed`
    apart: Sequence[str]  # methods that are not compared, as they lack too many runs


def compare(table: pd.DataFrame, views: pd.DataFrame, metric: str, methods: Sequence[str] = ()) -> Comparison:
    """Compare methods that learn from rainy views.

    Args:
        table: runs, as `gather.collect` has them, of one profile and track.
        views: the scores of their views, as `gather.collect_views` has them.
        metric: its name.
        methods: to compare, on the runs that all of them have; if none is named all there are, without those that
            lack too many runs. One without a finished run is listed, and not compared.

    Raises:
        InputError: no such metric or method, or no run that all of them have finished.
    """
    found = {one.name: one for one in find_metrics()}
    if metric not in found:
        raise unknown_name(f"METRIC={metric}", metric, "metric", found)
    table, views = _rainy(table), _rainy(views)
    known = sorted(set(table.method))
    for method in methods:
        if method not in known:
            raise unknown_name(f"METHOD={method}", method, "method with runs on rainy views", known)
    table = table[table.method.isin(methods or known)]
    scored = _finished(table, views, metric)
    finished = {name: int((scored.method == name).sum()) for name in methods or known}
    shared = compared_runs(scored, least=0 if methods else ENOUGH)
    if not shared.runs or (methods and shared.apart):
        raise InputError(
            "no run that all methods have finished",
            found=", ".join(f"{name} {n}" for name, n in finished.items()) or "no runs",
            fix="name those to compare with --methods, or evaluate what is missing",
        )
    finished = {name: n for name, n in finished.items() if name not in shared.apart}
    compared = [name for name in finished if name in shared.methods]
    scenes = scene_scores(views, metric, compared, shared.runs)
    planned = table[table.method.isin(finished)].drop_duplicates(["scene", "pattern", "seed"])
    pairs = _pairs(scenes, compared, found[metric])
    listed = _methods(scenes, finished, compared, len(planned), pairs, found[metric])
    first = [compared.index(name) for name in listed.method[:2] if name in compared]
    seeds = seeds_needed(differences(scenes, [(first[0], first[1])])) if len(first) == 2 else math.nan
    n_views = sum(scene.values.shape[0] * scene.values.shape[1] for scene in scenes)
    return Comparison(found[metric], listed, pairs, len(scenes), len(shared.runs), n_views, seeds, shared.apart)


def not_compared(apart: Sequence[str]) -> str:
    """A sentence on the methods that lack too many runs; empty for none."""
    return f"Not compared, since fewer than half of the runs are shared: {', '.join(apart)}." if apart else ""


def _rainy(rows: pd.DataFrame) -> pd.DataFrame:
    rows = rows[rows.pattern != CLEAN]
    return rows.assign(method=shown_names(rows))


def _finished(table: pd.DataFrame, views: pd.DataFrame, metric: str) -> pd.DataFrame:
    """The rows of runs in which every view has a finite score."""
    finite = views.assign(finite=np.isfinite(views[metric].to_numpy(float))).groupby(["method", *RUN]).finite.all()
    return table[pd.MultiIndex.from_frame(table[["method", *RUN]]).isin(finite.index[finite.to_numpy(bool)])]


def scene_scores(
    views: pd.DataFrame, metric: str, methods: Sequence[str], runs: set[tuple[Any, ...]]
) -> list[SceneScores]:
    """The scores of some methods on the same runs, scenes in order; M is the number of methods.

    Raises:
        InputError: methods have scores of other views on the same data.
    """
    wanted = views[views.method.isin(methods)].set_index(RUN)
    wanted = wanted[wanted.index.isin(runs)].reset_index()
    scenes = []
    for _, rows in wanted.groupby("scene"):
        names = sorted(set(rows.view))
        cube = rows.pivot_table(index=["pattern", "seed", "data_sha256"], columns=["view", "method"], values=metric)
        cube = cube.reindex(columns=pd.MultiIndex.from_product([names, methods]))
        values = cube.to_numpy(float).reshape(len(cube), len(names), len(methods))
        if np.isnan(values).any():
            raise InputError(
                f"{rows.scene.iloc[0]}: runs on the same data have other views",
                fix="evaluate them again with OVERWRITE=1",
            )
        patterns = np.unique(cube.index.get_level_values("pattern"), return_inverse=True)[1]
        scenes.append(SceneScores(values, patterns))
    return scenes


def differences(scenes: Sequence[SceneScores], pairs: Sequence[tuple[int, int]]) -> list[SceneScores]:
    """Scores of one method minus those of another on the same views; M is the number of pairs."""
    first, second = ([pair[i] for pair in pairs] for i in (0, 1))
    return [SceneScores(scene.values[..., first] - scene.values[..., second], scene.patterns) for scene in scenes]


def _pairs(scenes: Sequence[SceneScores], methods: Sequence[str], metric: Metric) -> pd.DataFrame:
    """All pairs, the better one first."""
    means = np.mean([scene.mean() for scene in scenes], axis=0)
    order = np.argsort(-means if metric.higher_is_better else means, kind="stable")
    pairs = [(int(a), int(b)) for a, b in combinations(order, 2)]
    columns = ["first", "second", "difference", "low", "high", "p", "p_holm", "significant"]
    if not pairs:
        return pd.DataFrame(columns=columns)
    apart = differences(scenes, pairs)
    found, p = estimate(apart), signed_rank_p(apart)
    corrected = holm(p)
    names = [[methods[pair[i]] for pair in pairs] for i in (0, 1)]
    significant = (corrected < SIGNIFICANT) & ((found.low > 0) | (found.high < 0))
    rows = (*names, found.mean, found.low, found.high, p, corrected, significant)
    return pd.DataFrame(dict(zip(columns, rows, strict=True)))


def _methods(
    scenes: Sequence[SceneScores],
    finished: Mapping[str, int],
    compared: Sequence[str],
    planned: int,
    pairs: pd.DataFrame,
    metric: Metric,
) -> pd.DataFrame:
    """A row a method, in order of rank.

    A rank is one more than the number of methods that finished more runs, or as many and are better beyond chance;
    a method without a finished run has none.
    """
    found = estimate(scenes)
    rows = pd.DataFrame({"method": compared, "mean": found.mean, "low": found.low, "high": found.high})
    rows = rows.set_index("method").reindex(list(finished))
    rows["finished"] = [finished[name] for name in rows.index]
    rows["planned"] = planned
    beaten = {(pair["first"], pair["second"]) for pair in pairs.to_dict("records") if pair["significant"]}
    ranks = [
        1 + sum(finished[a] > n or (finished[a] == n and (a, b) in beaten) for a in finished) if n else None
        for b, n in finished.items()
    ]
    rows["rank"] = pd.array(ranks, dtype="Int64")
    rows["order"] = -rows["mean"] if metric.higher_is_better else rows["mean"]
    rows = rows.sort_values(["finished", "order"], ascending=[False, True]).drop(columns="order")
    return rows.reset_index()[["rank", "method", "finished", "planned", "mean", "low", "high"]]


def in_words(comparison: Comparison, title: str) -> str:
    """A comparison as Markdown: methods, pairs, what it rests on, and who is not compared."""
    metric = comparison.metric
    methods = [
        (rank_text(row["rank"]), row["method"], _interval(metric, row, "mean"), f"{row['finished']}/{row['planned']}")
        for row in comparison.methods.to_dict("records")
    ]
    pairs = [
        (row["first"], row["second"], _interval(metric, row, "difference"), *_chance(row))
        for row in comparison.pairs.to_dict("records")
    ]
    parts = [title, markdown_table(("rank", "method", f"{metric.title} [95 %]", "runs"), methods, keep_empty=True)]
    if pairs:
        head = ("better", "than", f"{metric.title} by [95 %]", "p", "p (Holm)", "")
        parts.append(markdown_table(head, pairs, keep_empty=True))
    told = (f"{basis(comparison)} {_seeds(comparison)}".rstrip(), not_compared(comparison.apart))
    return "\n\n".join([*parts, *filter(None, told)]) + "\n"


def basis(comparison: Comparison) -> str:
    """A sentence on what the means of a comparison are over."""
    scenes = "1 scene" if comparison.n_scenes == 1 else f"{comparison.n_scenes} scenes"
    whose = "all of them" if comparison.methods["rank"].notna().all() else "all with a rank"
    return f"Means over the {comparison.n_runs} runs that {whose} have, on {scenes}, {comparison.n_views} views."


def rank_text(rank: Any) -> str:
    """A rank as tables show it; empty for a method without a finished run."""
    return "" if pd.isna(rank) else str(rank)


def _chance(pair: Mapping[Hashable, Any]) -> tuple[str, str, str]:
    return f"{pair['p']:.3g}", f"{pair['p_holm']:.3g}", "" if pair["significant"] else "tie"


def _interval(metric: Metric, row: Mapping[Hashable, Any], name: str) -> str:
    if math.isnan(row[name]):
        return ""
    bounds = "" if math.isnan(row["low"]) else f" [{metric.text(row['low'])}, {metric.text(row['high'])}]"
    return metric.text(row[name]) + bounds


def _seeds(comparison: Comparison) -> str:
    if len(comparison.pairs) == 0:
        return ""
    if math.isnan(comparison.seeds):
        return "How many seeds would tell the first two apart is known from two seeds on."
    if math.isinf(comparison.seeds):
        return "The first two are equal."
    return f"Seeds per pattern that would separate the first two methods on these scenes: {comparison.seeds:,.0f}."
