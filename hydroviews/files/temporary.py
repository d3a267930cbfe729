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
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from hydroviews.files.locks import LOCK, lock_path, locked_if_free

PARTIAL = ".partial-"
UNFINISHED = ".unpacked-"  # of a folder that an interrupted call resumes


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
    beside = path.parent.glob(f"*{PARTIAL}*-{glob.escape(path.name)}")
    inside = (Path(parent, name) for parent, folders, files in os.walk(path) for name in (*folders, *files))
    _remove_unused([*beside, *inside])


def remove_leftovers_in(folder: Path) -> None:
    """Remove what killed processes left half written of the files and folders that stand in a folder, not below these.

    Where no lock can be had, nothing is removed.
    """
    _remove_unused(folder.iterdir())


def remove_tree(folder: Path) -> None:
    """Remove a folder so that an interruption leaves nothing under its name."""
    if folder.exists():
        with temporary_beside(folder) as doomed:
            os.replace(folder, doomed)


def _remove_unused(paths: Iterable[Path]) -> None:
    """Remove those that have a temporary name which nobody uses."""
    found = (path for path in paths if path.name.startswith((PARTIAL, LOCK + PARTIAL)))
    # A lock may be alone: of a process killed just before or after.
    for leftover in sorted({path.with_name(path.name.removeprefix(LOCK)) for path in found}):
        with suppress(FileNotFoundError), locked_if_free(leftover) as free:  # another process removes them as well
            if free:
                _remove(leftover)


def _remove(temporary: Path) -> None:
    """Remove a temporary file or folder and its lock, which the caller holds."""
    if temporary.is_dir() and not temporary.is_symlink():
        shutil.rmtree(temporary, ignore_errors=True)
    else:
        temporary.unlink(missing_ok=True)
    lock_path(temporary).unlink(missing_ok=True)
