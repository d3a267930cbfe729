"""The Pareto front against its definition, and where a drawing puts things."""

import itertools

import numpy as np
import pandas as pd
import pytest

from hydroviews.metrics import find_metrics
from leaderboard.site.axes import BOTTOM, HEIGHT, TOP, WIDTH
from leaderboard.site.pareto import LETTER, LINE, draw, pareto_front

PSNR, LPIPS = find_metrics()[0], find_metrics()[2]


def board(n: int) -> pd.DataFrame:
    rng = np.random.default_rng(n)
    names = [f"method-{i}" for i in range(n)]
    numbers = {"train_s": 10 ** rng.uniform(0, 4, n), "psnr": rng.normal(25, 2, n), "lpips_alex": rng.uniform(0, 1, n)}
    return pd.DataFrame({**numbers, "reference": [i == 0 for i in range(n)]}, index=names)


def test_a_point_is_on_the_front_if_no_other_beats_it():
    assert pareto_front([1, 2, 3, 2, 1], [20, 25, 24, 25, 21]) == [False, True, False, True, True]  # equal ones both
    costs, qualities = np.random.default_rng(0).uniform(size=(2, 30))
    best = [max(qualities[costs <= cost]) for cost in costs]
    assert pareto_front(list(costs), list(qualities)) == [q == top for q, top in zip(qualities, best, strict=True)]


@pytest.mark.parametrize("metric", [PSNR, LPIPS])
def test_the_drawing_keeps_order_frame_and_distances(metric):
    means = board(9)
    plot = draw(means, "train_s", "train s", metric)
    at = {point.method: point for point in plot.points}
    assert all(0 < p.x < WIDTH and 0 < p.y < HEIGHT for p in plot.points)
    for a, b in itertools.combinations(means.index, 2):
        assert (at[a].x < at[b].x) == (means.train_s[a] < means.train_s[b])
        assert (at[a].y > at[b].y) == (means[metric.name][a] < means[metric.name][b])
    ours = means.index[1:]
    sign = 1 if metric.higher_is_better else -1
    front = pareto_front(list(means.train_s[ours]), list(sign * means[metric.name][ours]))
    assert [at[name].front for name in ours] == front
    assert at["method-0"].reference
    assert not at["method-0"].front
    assert len(plot.front.split()) == sum(front)
    assert len(plot.x_ticks) >= 3
    assert len(plot.y_ticks) >= 3


def test_equal_costs_are_drawn_and_one_method_or_no_numbers_are_not():
    plot = draw(board(3).assign(train_s=7.0), "train_s", "train s", PSNR)
    assert len({point.x for point in plot.points}) == 1
    assert draw(board(1), "train_s", "train s", PSNR) is None
    assert draw(board(4).assign(train_s=np.nan), "train_s", "train s", PSNR) is None


@pytest.mark.parametrize("same_cost", [False, True])
def test_labels_stay_in_the_frame_and_cover_no_other(same_cost):
    means = board(15)
    means["psnr"] = 20 + means.psnr / 50  # close together, far below a single one
    means.loc["method-0", "psnr"] = 35.0
    if same_cost:
        means["train_s"] = 7.0
    points = draw(means, "train_s", "train s", PSNR).points
    boxes = []
    for p in points:
        assert TOP <= p.label_y <= HEIGHT - BOTTOM
        length = LETTER * len(p.method)
        boxes.append((p.label_x - length * (p.anchor == "end"), p.label_x + length * (p.anchor == "start"), p.label_y))
    for (low, high, height), (left, right, other) in itertools.combinations(boxes, 2):
        assert abs(height - other) >= LINE or high <= left or right <= low
