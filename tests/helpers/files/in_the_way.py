"""Something else where a file belongs: what a folder and a named pipe do to a reader."""

import os
import shutil
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

KINDS = ("folder", "named pipe")
PATIENCE = 120  # seconds until a reader that waits for a pipe is taken to wait for ever


def swap(path: Path, kind: str) -> None:
    """Put something of a kind in a file's place."""
    shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)
    path.mkdir() if kind == "folder" else os.mkfifo(path)


@contextmanager
def not_for_ever() -> Iterator[None]:
    """Fails where the block waits for ever."""

    def late(*_: object) -> None:
        raise AssertionError("waits for ever")

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(PATIENCE)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)
