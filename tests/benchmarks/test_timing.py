import pytest

from benchmarks.timing import counted, counted_seconds


def test_seconds_of_several_sessions_add_up(tmp_path):
    total = tmp_path / "seconds.txt"
    assert counted_seconds(total) == 0
    with pytest.raises(KeyboardInterrupt), counted(total):
        sum(range(2_000_000))
        raise KeyboardInterrupt
    once = counted_seconds(total)
    assert once > 0
    with counted(total):
        sum(range(2_000_000))
    assert counted_seconds(total) > once
