"""What a training's fair share is on a machine with others, and that the benchmark's steps are counted."""

import numba
import pytest

from benchmarks import busy_machine
from benchmarks.busy_machine import fair_share, measured


@pytest.mark.parametrize(
    ("steps", "threads", "competing", "share"),
    [
        (50, 2, 0, 1.0),  # idle
        (25, 2, 2, 1.0),  # half of the four threads on two cores are its own
        (20, 2, 2, 0.8),
        (50, 1, 1, 1.0),  # a core for each
        (25, 1, 3, 1.0),
    ],
)
def test_fair_is_a_threads_share_of_the_cores(steps, threads, competing, share):
    assert fair_share(steps, 50, threads, competing, cores=2) == pytest.approx(share)


def test_steps_are_counted(monkeypatch):
    monkeypatch.setattr(busy_machine, "GAUSSIANS", 200)
    monkeypatch.setattr(busy_machine, "SIZE", (48, 36))
    before = numba.get_num_threads()
    try:
        assert measured(1, 0.01) > 0
    finally:
        numba.set_num_threads(before)
