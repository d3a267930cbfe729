"""Locks between threads and processes: hidden files beside what they protect, on a shared disk as well.

The system releases the lock of a process that was killed. Lock files stay where they are, since one that is removed
while others wait for it would be locked twice.
"""

import errno
import logging
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from filelock import FileLock, Timeout

from hydroviews.files.full_disk import plain_full_disk

logger = logging.getLogger(__name__)

LOCK = ".lock-"
BUSY = "another process is at work on it; waiting"
LOCKLESS = (errno.EROFS, errno.EACCES, errno.EPERM, errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP)  # no lock can be had


def lock_path(path: Path) -> Path:
    """The hidden file that is locked for a file or folder: `.lock-<name>` beside it."""
    return path.with_name(LOCK + path.name)


@contextmanager
def locked(path: Path, waiting: str = "") -> Iterator[None]:
    """Lock a file or folder until the block ends: other threads and processes that lock it wait.

    In a folder that cannot be written to, and on a file system without locks, nobody waits.

    Args:
        path: need not exist.
        waiting: what to warn of before waiting; the host and the number of the process waited for are added.

    Raises:
        InputError: a file is in the way of the folder that `path` is in, or the disk is full.
        RuntimeError: this thread holds the lock already.
    """
    lock = _acquire(path, waiting)
    try:
        yield
    finally:
        if lock:
            lock.release()


@contextmanager
def locked_if_free(path: Path) -> Iterator[bool]:
    """Lock a file or folder until the block ends, unless its lock is held.

    Yields:
        Whether it is locked now: False as well in a folder that cannot be written to, and on a file system without
        locks.
    """
    lock = FileLock(lock_path(path), fallback_to_soft=False)
    try:
        yield _take_if_free(lock)
    finally:
        lock.release()  # does nothing if it is not held


def _take_if_free(lock: FileLock) -> bool:
    try:
        lock.acquire(blocking=False)
    except OSError as error:
        if isinstance(error, Timeout) or error.errno in LOCKLESS:
            return False
        raise
    return True


def _acquire(path: Path, waiting: str) -> FileLock | None:
    """The held lock; None where no lock can be had."""
    lock = FileLock(lock_path(path), fallback_to_soft=False)
    try:
        with plain_full_disk(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            _wait_for(lock, path, waiting)
    except OSError as error:
        if error.errno not in LOCKLESS:
            raise
        return None
    with suppress(OSError):  # a full disk: who holds the lock is only for people to read
        lock_path(path).write_text(f"{socket.gethostname()}, process {os.getpid()}")
    return lock


def _wait_for(lock: FileLock, path: Path, waiting: str) -> None:
    try:
        lock.acquire(blocking=False)
    except Timeout:
        if waiting:
            logger.warning("%s: %s%s", path, waiting, _holder(path))
        lock.acquire()


def _holder(path: Path) -> str:
    """Who holds the lock of `path`, as the end of a sentence; empty where it is not known."""
    try:
        holder = lock_path(path).read_text()
    except OSError:
        return ""
    return f" for {holder}" if holder else ""
