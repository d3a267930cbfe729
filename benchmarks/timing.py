"""Processor time of what takes milliseconds in one process, and of what takes several sessions."""

import resource
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from hydroviews.files.atomic import write_bytes


def least(function: Callable[[], Any], repeats: int) -> float:
    """Milliseconds of processor time of the fastest of several turns, after one that is not counted."""
    function()
    turns = []
    for _ in range(repeats):
        start = time.process_time()
        function()
        turns.append(time.process_time() - start)
    return 1000 * min(turns)


@contextmanager
def counted(total: Path) -> Iterator[None]:
    """Add the seconds of what is done meanwhile to a file's, also where it is interrupted."""
    before = _cpu_seconds()
    try:
        yield
    finally:
        write_bytes(total, str(counted_seconds(total) + _cpu_seconds() - before).encode())


def counted_seconds(total: Path) -> float:
    """What `counted` has added up in a file; 0 where there is none."""
    return float(total.read_text()) if total.is_file() else 0.0


def _cpu_seconds() -> float:
    """Of this process and of those that it started and that have ended."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime
