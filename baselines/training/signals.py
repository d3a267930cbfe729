"""Stopping a training: signals take effect after the step, and a clock adds up sessions."""

import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

from hydroviews.cli.processes import Ended

PATIENCE = 20  # times what a checkpoint costs until the next one


class Clock:
    """Seconds of training, going on from those of earlier sessions."""

    def __init__(self, before: float):
        self._zero = time.perf_counter() - before

    @property
    def seconds(self) -> float:
        """Of all sessions."""
        return time.perf_counter() - self._zero


class Saving:
    """When a checkpoint is due: now and then, and never so often that writing them takes a twentieth of the time."""

    def __init__(self, clock: Clock, every: float):
        """Of a training's clock; `every` is in seconds between two checkpoints that cost little, 0 for all steps."""
        self._clock, self._every = clock, every
        self._last, self._cost = clock.seconds, 0.0

    @property
    def due(self) -> bool:
        """Whether it is time."""
        return not self._every or self._clock.seconds - self._last > max(self._every, PATIENCE * self._cost)

    @contextmanager
    def timed(self) -> Iterator[None]:
        """Around the writing of a checkpoint."""
        start = self._clock.seconds
        yield
        self._last = self._clock.seconds
        self._cost = self._last - start


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
        Ended: on SIGTERM.
    """
    if received:
        raise KeyboardInterrupt if received[0] == signal.SIGINT else Ended(received[0])
