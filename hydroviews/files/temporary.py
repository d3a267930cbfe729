"""Temporary names beside the files and folders they are to become, and what killed processes leave under them.

A temporary name holds the host's name and a random part, so that no two processes have the same one, on several
machines or in several containers either. Its lock is held as long as it is in use: a leftover is a temporary name whose
lock is free.
"""

import glob
import os
import shutil
import socket
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from hydroviews.files.locks import LOCK, lock_path, locked_if_free

PARTIAL = ".partial-"


@contextmanager
def temporary_beside(path: Path) -> Iterator[Path]:
    """A hidden path beside `path`, used by nobody else; what is there at the end of the block is removed.

    The name ends in that of `path`, so that writers which choose a format by suffix work.
    """
    host = socket.gethostname().partition(".")[0]
    temporary = path.with_name(f"{PARTIAL}{host}-{uuid.uuid4().hex[:12]}-{path.name}")
    path.parent.mkdir(parents=True, exist_ok=True)
    with locked_if_free(temporary):
        try:
            yield temporary
        finally:
            _remove(temporary)


def remove_leftovers(path: Path) -> None:
    """Remove what killed processes left half written of a file or folder: beside it, and anywhere in it.

    Where no lock can be had, nothing is removed.
    """
    for leftover in _temporaries(path):
        with suppress(FileNotFoundError), locked_if_free(leftover) as free:  # another process removes them as well
            if free:
                _remove(leftover)


def remove_tree(folder: Path) -> None:
    """Remove a folder so that an interruption leaves nothing under its name."""
    if folder.exists():
        with temporary_beside(folder) as doomed:
            os.replace(folder, doomed)


def _temporaries(path: Path) -> list[Path]:
    """Temporary names of a file or folder and of what is in it, in use or not."""
    beside = f"{PARTIAL}*-{glob.escape(path.name)}"
    found = [*path.parent.glob(beside), *path.parent.glob(LOCK + beside)]
    for parent, folders, files in os.walk(path):  # which passes over a folder that is gone by now
        inside = (Path(parent, name) for name in (*folders, *files))
        found += [one for one in inside if one.name.startswith((PARTIAL, LOCK + PARTIAL))]
    # A lock may be alone: of a process killed just before or after.
    return sorted({one.with_name(one.name.removeprefix(LOCK)) for one in found})


def _remove(temporary: Path) -> None:
    """Remove a temporary file or folder and its lock, which the caller holds."""
    if temporary.is_dir() and not temporary.is_symlink():
        shutil.rmtree(temporary, ignore_errors=True)
    else:
        temporary.unlink(missing_ok=True)
    lock_path(temporary).unlink(missing_ok=True)
