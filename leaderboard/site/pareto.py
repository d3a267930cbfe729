"""Quality against a cost: which methods no other beats in both, and where each stands in a drawing."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import pandas as pd

from hydroviews.metrics import Metric
from leaderboard.site.axes import BOTTOM, HEIGHT, LEFT, TOP, WIDTH, Ticks, across, log_ticks, ticks, up, widened
from leaderboard.tables.markdown import cost_text

LINE = 13  # height of a line of labels
LETTER = 6  # width of a label's letter, about


@dataclass(frozen=True)
class Point:
    """A method in the drawing."""

    method: str
    x: float
    y: float
    label_x: float
    label_y: float
    anchor: str  # start or end: on which side of it the label is
    front: bool
    reference: bool
    told: str  # its numbers


@dataclass(frozen=True)
class Plot:
    """A drawing of quality (up, of a metric) against a cost (to the right, logarithmic)."""

    cost: str
    quality: str
    points: tuple[Point, ...]
    front: str  # corners of the line, for `<polyline>`
    x_ticks: Ticks
    y_ticks: Ticks


def pareto_front(costs: Sequence[float], qualities: Sequence[float]) -> list[bool]:
    """Which points no other beats: at most as dear and at least as good, and in one of them better.

    Qualities are better the higher they are.
    """
    pairs = list(zip(costs, qualities, strict=True))
    return [
        not any(c <= cost and q >= quality and (c < cost or q > quality) for c, q in pairs) for cost, quality in pairs
    ]


def draw(means: pd.DataFrame, name: str, title: str, metric: Metric) -> Plot | None:
    """The drawing of a table of `tables.cost_means`; None with fewer than two methods that have both numbers.

    Methods that learn from clean views are shown, and are not on the front.

    Args:
        means: the table.
        name: column of the cost.
        title: of the cost.
        metric: quality.
    """
    known = means[means[name].notna() & means[metric.name].notna() & (means[name].astype(float) > 0)]
    if len(known) < 2:
        return None
    cost, quality = known[name].astype(float), known[metric.name].astype(float)
    ours = ~known.reference.astype(bool)
    sign = 1 if metric.higher_is_better else -1
    on_front = dict(zip(known.index[ours], pareto_front(list(cost[ours]), list(sign * quality[ours])), strict=True))
    right = widened(math.log10(cost.min()), math.log10(cost.max()), 0.05)
    upwards = widened(quality.min(), quality.max(), 0.1)
    places = {str(m): (across(math.log10(cost[m]), right), up(quality[m], upwards)) for m in known.index}
    labels = _labels(places)
    points = tuple(
        Point(
            method,
            x,
            y,
            *labels[method],
            on_front.get(method, False),
            bool(known.reference[method]),
            f"{metric.title} {metric.text(quality[method])}, {title} {cost_text(cost[method])}",
        )
        for method, (x, y) in places.items()
    )
    corners = sorted((point.x, point.y) for point in points if point.front)
    shown = log_ticks(10 ** right[0], 10 ** right[1])
    x_ticks = tuple((across(math.log10(value), right), f"{value:g}") for value in shown)
    y_ticks = tuple((up(value, upwards), f"{value:g}") for value in ticks(*upwards))
    return Plot(title, metric.title, points, " ".join(f"{x},{y}" for x, y in corners), x_ticks, y_ticks)


def _labels(places: dict[str, tuple[float, float]]) -> dict[str, tuple[float, float, str]]:
    """Where labels stand: each in the nearest line of the frame in which it covers no other."""
    found: dict[str, tuple[float, float, str]] = {}
    taken: dict[int, list[tuple[float, float]]] = {line: [] for line in range(TOP + LINE, HEIGHT - BOTTOM, LINE)}
    for method, (x, y) in sorted(places.items(), key=lambda item: item[1][1]):
        right = x < (LEFT + WIDTH) / 2
        start = x + 8 if right else x - 8
        low, high = sorted((start, start + (LETTER if right else -LETTER) * len(method)))
        covers = {line: any(left < high and low < end for left, end in others) for line, others in taken.items()}
        line = min(taken, key=lambda line: (covers[line], abs(line - y - 4)))
        taken[line].append((low, high))
        found[method] = (start, line, "start" if right else "end")
    return found
