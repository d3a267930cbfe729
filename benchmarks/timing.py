"""Processor time of things that take milliseconds to seconds."""

import time
from collections.abc import Callable
from typing import Any


def least(function: Callable[[], Any], repeats: int) -> float:
    """Milliseconds of processor time of the fastest of several turns, after one that is not counted."""
    function()
    turns = []
    for _ in range(repeats):
        start = time.process_time()
        function()
        turns.append(time.process_time() - start)
    return 1000 * min(turns)
