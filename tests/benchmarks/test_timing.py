import pytest

from benchmarks.timing import counted, counted_seconds


def work() -> None:
    sum(i * i for i in range(2_000_000))


def test_seconds_of_several_sessions_add_up(tmp_path):
    total = tmp_path / "seconds.txt"
    assert counted_seconds(total) == 0
    with pytest.raises(KeyboardInterrupt), counted(total):
        work()
        raise KeyboardInterrupt
    once = counted_seconds(total)
    assert once > 0.01
    with counted(total):
        work()
    assert counted_seconds(total) > once + 0.01
