"""Trainings that are stopped: signals that wait for the end of a step, and a clock that goes on over sessions."""

import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager


class Clock:
    """Seconds of training, going on from those of earlier sessions."""

    def __init__(self, before: float):
        self._zero = time.perf_counter() - before

    @property
    def seconds(self) -> float:
        """Of all sessions."""
        return time.perf_counter() - self._zero


@contextmanager
def stop_signals() -> Iterator[list[int]]:
    """Collects SIGINT and SIGTERM, so that a step is never cut in half; only the main thread may."""
    received: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        yield received
        return
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = {n: signal.signal(n, lambda number, _: received.append(number)) for n in numbers}
    try:
        yield received
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def end_stopped(received: list[int]) -> None:
    """Ends the process as the first of the collected signals asks, once what must be saved is saved.

    Raises:
        KeyboardInterrupt: on SIGINT.
        SystemExit: on SIGTERM.
    """
    if received:
        raise KeyboardInterrupt if received[0] == signal.SIGINT else SystemExit(128 + received[0])
