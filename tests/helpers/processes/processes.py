"""Waiting for processes that a test has started."""

import time

PATIENCE = 600  # seconds before a test gives a process up: many, as the machine may be busy with other things


def wait_until(condition, process):
    """Return once a condition holds, and fail if the process ends before that, or after a long time."""
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.02)
