"""Learning curves: drawn to scale, and passed over with a reason where the file is none."""

import logging

import pytest

from baselines.training.learning_curve import LEARNING_CURVE, write_rows
from leaderboard.site.axes import BOTTOM, HEIGHT, LEFT, RIGHT, TOP, WIDTH, across, log_ticks, ticks, up, widened
from leaderboard.site.learning_curves import learning_curves


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
    ("text", "drawn"),
    [
        ("step,seconds,loss\n1,1,0.5\n2,2,inf\n3,3,0.4\n", ["loss"]),
        ("step,seconds,loss\n1,1,0.5\n2,2,0.5\n", ["loss"]),  # never changes
        ("step,seconds,loss,size\n1,1,0.5,nan\n2,2,0.4,nan\n", ["loss"]),
        ("step,seconds,loss\n1,1,0.5\n", []),  # one row is no curve
        ("step,seconds,loss\n1,nan,0.5\n2,2,0.5\n", []),
        ("step,seconds,loss\n", []),
    ],
)
def test_what_is_not_finite_or_not_there_is_left_out(tmp_path, text, drawn):
    assert learning_curves(tmp_path) == []
    (tmp_path / LEARNING_CURVE).write_text(text)
    curves = learning_curves(tmp_path)
    assert [curve.name for curve in curves] == drawn
    assert not any("nan" in curve.points + curve.told for curve in curves)


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"step,seconds,loss\na,b,c\n",
        b"loss\n1\n2\n",
        b"step,seconds\n1,2\n3\n",
        b"\xff\xfe\x00\x01",
        b"step,seconds\n1," + b"2" * 200_000,  # more than the reader takes for a cell
    ],
)
def test_a_file_that_is_no_learning_curve_is_named(tmp_path, content, caplog):
    (tmp_path / LEARNING_CURVE).write_bytes(content)
    with caplog.at_level(logging.WARNING):
        assert learning_curves(tmp_path) == []
    assert f"{LEARNING_CURVE}: not drawn" in caplog.text


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
