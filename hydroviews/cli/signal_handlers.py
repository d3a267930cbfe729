"""Handlers of signals that libraries install while they are imported, undone."""

import ctypes
import signal
from collections.abc import Iterator
from contextlib import contextmanager

# What a library with a handler for crashes takes: SIGTERM too, so that a worker which is ended looks like a crash.
CRASHES = (signal.SIGABRT, signal.SIGBUS, signal.SIGFPE, signal.SIGILL, signal.SIGSEGV, signal.SIGTERM)
ACTION = 1024  # bytes, more than any system's `struct sigaction`


@contextmanager
def kept_handlers() -> Iterator[None]:
    """Leaves the handlers of CRASHES as they were before the block, in any thread.

    Python's `signal` knows only handlers that were installed through it, and works in the main thread alone.
    """
    sigaction = ctypes.CDLL(None).sigaction
    before = {number: ctypes.create_string_buffer(ACTION) for number in CRASHES}
    for number, action in before.items():
        sigaction(int(number), None, action)
    try:
        yield
    finally:
        for number, action in before.items():
            sigaction(int(number), action, None)
