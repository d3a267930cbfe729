"""Work on several pictures at once: one thread for each of two processors."""

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")

AT_ONCE = 2  # pictures, so that memory is that of two, whatever the number of processors


def cores() -> list[int]:
    """The numbers of those that this process may use, sorted."""
    return sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else list(range(os.cpu_count() or 1))


def processors() -> int:
    """How many this process may use."""
    return len(cores())


def side_by_side(function: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[Result]:
    """`function` of each item, in order; at most two are at work or waiting to be taken.

    What goes wrong with an item is raised in its place, and no further item is begun.
    """
    begun: deque[Future[Result]] = deque()
    with ThreadPoolExecutor(min(AT_ONCE, processors())) as pool:
        try:
            for item in items:
                begun.append(pool.submit(function, item))
                if len(begun) == AT_ONCE:
                    yield begun.popleft().result()
            while begun:
                yield begun.popleft().result()
        finally:
            for future in begun:
                future.cancel()
