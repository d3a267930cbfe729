"""Comparisons of methods as the pages show them: ranks, means and intervals that are drawn."""

from collections.abc import Hashable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from hydroviews.errors import InputError
from hydroviews.metrics import Metric, find_metrics
from leaderboard.tables.comparison import basis, compare, not_compared, rank_text


@dataclass(frozen=True)
class Ranked:
    """A method, with the places of its mean and the ends of its interval in per cent of the drawing's width."""

    rank: str  # empty for one without a finished run
    method: str
    runs: str
    missing: bool  # lacks runs
    value: float | None
    mean: str
    interval: str
    at: tuple[float, ...] | None  # low, mean, high


@dataclass(frozen=True)
class Told:
    """A comparison by one metric; where there is none, why."""

    metric: Metric
    methods: tuple[Ranked, ...]
    pairs: tuple[tuple[str, str, str, str, str], ...]  # better, than, by, p (Holm), tie or nothing
    basis: str


def comparisons(rows: pd.DataFrame, views: pd.DataFrame) -> list[Told]:
    """The methods of a profile, track and suite by every metric; one that lacks too many runs stays out.

    Args:
        rows: runs.
        views: the scores of their views.
    """
    return [_told(rows, views, metric) for metric in find_metrics()]


def _told(rows: pd.DataFrame, views: pd.DataFrame, metric: Metric) -> Told:
    try:
        found = compare(rows, views, metric.name)
    except InputError as error:
        return Told(metric, (), (), f"{error}.")
    bounds = found.methods[["low", "mean", "high"]].astype(float)
    low, high = (float(end(bounds.to_numpy())) for end in (np.nanmin, np.nanmax))
    ranked = tuple(_ranked(row, metric, low, high) for row in found.methods.to_dict("records"))
    pairs = tuple(_pair(row, metric) for row in found.pairs.to_dict("records"))
    return Told(metric, ranked, pairs, f"{basis(found)} {not_compared(found.apart)}".rstrip())


def _ranked(row: Mapping[Hashable, Any], metric: Metric, low: float, high: float) -> Ranked:
    ends = [float(row[name]) for name in ("low", "mean", "high")]
    known = not pd.isna(ends[1])
    drawn = known and high > low and not pd.isna(ends[0])
    at = tuple(round(2 + 96 * (end - low) / (high - low), 2) for end in ends) if drawn else None
    return Ranked(
        rank_text(row["rank"]),
        str(row["method"]),
        f"{row['finished']}/{row['planned']}",
        row["finished"] < row["planned"],
        ends[1] if known else None,
        metric.text(ends[1]) if known else "",
        f"{metric.text(ends[0])} to {metric.text(ends[2])}" if known and not pd.isna(ends[0]) else "",
        at,
    )


def _pair(row: Mapping[Hashable, Any], metric: Metric) -> tuple[str, str, str, str, str]:
    by = metric.text(row["difference"])
    if not pd.isna(row["low"]):
        by += f" ({metric.text(row['low'])} to {metric.text(row['high'])})"
    return row["first"], row["second"], by, f"{row['p_holm']:.3g}", "" if row["significant"] else "tie"
