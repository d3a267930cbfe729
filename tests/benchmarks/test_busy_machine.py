"""The fair share of a training on a machine with others, and the count of the benchmark's steps."""

from pathlib import Path

import pytest
from kernel_fixtures import single_threaded

from benchmarks import busy_machine
from benchmarks.busy_machine import cases, convolutions, fair_share, measured, table_of
from hydroviews.cli.threads import processors


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


def test_a_share_is_of_the_idle_machine_with_threads_as_they_wait_by_default():
    def steps_of(case, others, seconds):
        idle = {"spin": 50.0, "spin shortly": 49.0, "ours": 49.0, "sleep": 40.0}[case.waiting]
        return idle / (1 + others / case.threads)

    chosen = cases([Path("a"), Path("b")])
    assert len({(case.work, case.threads, case.waiting, case.checkout) for case in chosen}) == len(chosen) == 13
    table = table_of(chosen, [2], 1.0, 3, steps_of)
    assert len(table) == 26
    shares = table.set_index(["work", "threads", "waiting", "checkout", "competing"])["fair share"]
    two = {key[2:]: share for key, share in shares.items() if key[:2] == ("splatting", 2)}
    assert two["spin", Path("a"), 0] == 1.0
    assert two["sleep", Path("b"), 0] == 0.8
    assert two["spin shortly", Path("b"), 2] == pytest.approx(fair_share(24.5, 50, 2, 2, processors()), abs=0.006)


@pytest.mark.parametrize("count", [convolutions, measured])
def test_steps_are_counted(monkeypatch, count):
    monkeypatch.setattr(busy_machine, "GAUSSIANS", 200)
    monkeypatch.setattr(busy_machine, "SIZE", (48, 36))
    with single_threaded():  # whose end gives back the threads that are set here
        assert count(1, 0.01) > 0
