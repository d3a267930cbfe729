"""Learning curves and Pareto fronts: drawn to scale, and passed over where there is nothing to draw."""

import itertools
import logging

import numpy as np
import pandas as pd
import pytest

from baselines.training.learning_curve import LEARNING_CURVE, write_rows
from hydroviews.metrics import find_metrics
from leaderboard.site.axes import BOTTOM, HEIGHT, LEFT, RIGHT, TOP, WIDTH, across, log_ticks, ticks, up, widened
from leaderboard.site.learning_curves import learning_curves
from leaderboard.site.pareto import LETTER, LINE, draw, pareto_front


def corners(curve):
    return [tuple(float(number) for number in point.split(",")) for point in curve.points.split()]


def test_a_curve_begins_at_zero_seconds_and_is_to_scale(tmp_path):
    rows = [(1, 10.0, 0.4, 8000), (2, 20.0, 0.2, 8000), (3, 40.0, 0.1, 30000)]
    write_rows(tmp_path / LEARNING_CURVE, ("step", "seconds", "loss", "Gaussians"), rows)
    loss, gaussians = learning_curves(tmp_path)
    assert (loss.name, gaussians.name) == ("loss", "Gaussians")
    assert loss.told == "0.4 at first, 0.1 after 40 s"
    (x, y), second, last = corners(loss)
    width = WIDTH - LEFT - RIGHT
    assert [x, second[0], last[0]] == pytest.approx([LEFT + width / 4, LEFT + width / 2, WIDTH - RIGHT])
    assert (second[1] - y) / (last[1] - second[1]) == pytest.approx(2, abs=0.02)
    assert TOP < y < second[1] < last[1] < HEIGHT - BOTTOM  # what falls is drawn further down
    assert all(LEFT <= place <= WIDTH - RIGHT for place, _ in loss.x_ticks)
    assert len(loss.x_ticks) >= 3


@pytest.mark.parametrize(
    ("content", "drawn"),
    [
        (b"step,seconds,loss\n1,1,0.5\n2,2,inf\n3,3,0.4\n", ["loss"]),
        (b"step,seconds,loss\n1,1,0.5\n2,2,0.5\n", ["loss"]),  # never changes
        (b"step,seconds,loss,size\n1,1,0.5,nan\n2,2,0.4,nan\n", ["loss"]),
        (b"step,seconds,loss\n1,1,0.5\n", []),  # one row is no curve
        (b"step,seconds,loss\n1,nan,0.5\n2,2,0.5\n", []),
        (b"step,seconds,loss\n", []),
        (b"", None),
        (b"step,seconds,loss\na,b,c\n", None),
        (b"loss\n1\n2\n", None),
        (b"step,seconds\n1,2\n3\n", None),
        (b"\xff\xfe\x00\x01", None),
        (b"step,seconds\n1," + b"2" * 200_000, None),  # more than the reader takes for a cell
    ],
)
def test_what_is_not_finite_is_left_out_and_a_file_that_is_no_learning_curve_is_named(tmp_path, content, drawn, caplog):
    assert learning_curves(tmp_path) == []
    (tmp_path / LEARNING_CURVE).write_bytes(content)
    with caplog.at_level(logging.WARNING):
        curves = learning_curves(tmp_path)
    assert [curve.name for curve in curves] == (drawn or [])
    assert not any("nan" in curve.points + curve.told for curve in curves)
    assert (f"{LEARNING_CURVE}: not drawn" in caplog.text) == (drawn is None)


@pytest.mark.parametrize(("low", "high"), [(-3.2, 7), (0.001, 0.0011), (0, 1e-6), (20.1, 20.4), (1e3, 1e6)])
def test_ticks_are_round_and_inside_a_span_that_is_never_empty(low, high):
    found = ticks(low, high)
    assert 2 <= len(found) <= 16
    assert all(low - 1e-6 <= value <= high + 1e-6 for value in found)
    span = widened(low, low, 0.1)
    assert span[0] < low < span[1]
    assert (across(0.0, (0, 10)), across(10.0, (0, 10))) == (LEFT, WIDTH - RIGHT)
    assert (up(0.0, (0, 10)), up(10.0, (0, 10))) == (HEIGHT - BOTTOM, TOP)
    assert log_ticks(0.9, 110) == [1, 10, 100]


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
    ours, sign = means.index[1:], 1 if metric.higher_is_better else -1
    front = pareto_front(list(means.train_s[ours]), list(sign * means[metric.name][ours]))
    assert [at[name].front for name in ours] == front
    assert (at["method-0"].reference, at["method-0"].front) == (True, False)
    assert len(plot.front.split()) == sum(front)
    assert min(len(plot.x_ticks), len(plot.y_ticks)) >= 3


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
    boxes = []
    for p in draw(means, "train_s", "train s", PSNR).points:
        assert TOP <= p.label_y <= HEIGHT - BOTTOM
        length = LETTER * len(p.method)
        boxes.append((p.label_x - length * (p.anchor == "end"), p.label_x + length * (p.anchor == "start"), p.label_y))
    for (low, high, height), (left, right, other) in itertools.combinations(boxes, 2):
        assert abs(height - other) >= LINE or high <= left or right <= low
