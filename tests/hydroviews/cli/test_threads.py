import threading
import time

import pytest

from hydroviews.cli import threads
from hydroviews.cli.threads import side_by_side


@pytest.fixture(autouse=True)
def two_processors(monkeypatch):
    monkeypatch.setattr(threads, "processors", lambda: 2)


def test_results_come_in_order_and_two_are_worked_on_at_once():
    together = threading.Barrier(2, timeout=30)  # broken unless two threads meet

    def work(item):
        together.wait()
        time.sleep(0.02 if item % 2 == 0 else 0)  # the first of two ends last
        return 10 * item

    assert list(side_by_side(work, range(6))) == [0, 10, 20, 30, 40, 50]
    assert list(side_by_side(work, [])) == []


def test_no_more_than_two_results_wait_to_be_taken():
    begun = []
    results = side_by_side(lambda item: begun.append(item) or item, iter(range(50)))
    assert next(results) == 0
    assert len(begun) <= threads.AT_ONCE
    results.close()
    assert len(begun) <= threads.AT_ONCE


def test_what_fails_is_raised_in_its_place_and_nothing_more_is_begun():
    begun = []

    def work(item):
        begun.append(item)
        if item == 2:
            raise ValueError(f"item {item}")
        return item

    results = side_by_side(work, range(50))
    assert [next(results), next(results)] == [0, 1]
    with pytest.raises(ValueError, match="item 2"):
        next(results)
    assert max(begun) <= 3
