"""Files that are either whole or not there: write to a temporary name, then rename."""

import errno
import fcntl
import hashlib
import json
import os
import shutil
import sys
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import IO, Any

from hydroviews.errors import InputError

PARTIAL = ".partial-"
LOCK = ".lock-"
BUSY = "another process is at work on it; waiting"
FULL = (errno.ENOSPC, errno.EDQUOT)
CLOSED = (errno.EACCES, errno.EPERM, errno.EROFS)
LOCKLESS = (errno.EROFS, errno.EACCES, errno.EPERM, errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP)  # no lock can be had


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary path beside `path` that takes its name once the block has ended well.

    The suffix is kept, so that writers which choose a format by suffix work. On an exception the
    temporary file is removed and `path` stays as it was.

    Raises:
        InputError: the disk is full.
    """
    temporary = path.with_name(f"{PARTIAL}{os.getpid()}-{path.name}")
    with plain_full_disk(path):
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            yield temporary
            os.replace(temporary, path)
        except OSError as error:
            if error.errno not in CLOSED:
                raise
            raise InputError(f"{path}: cannot be written", found=error.strerror, fix="choose another folder") from error
        finally:
            if temporary.is_file():
                temporary.unlink()


@contextmanager
def plain_full_disk(path: Path) -> Iterator[None]:
    """Turns a full disk, however a library tells it, into an error that says what to do.

    Raises:
        InputError: the disk is full, or what one may use of it.
    """
    try:
        yield
    except Exception as error:
        if isinstance(error, NotADirectoryError | FileExistsError):
            raise InputError(
                f"{path.parent}: not a folder", found="a file of that name", fix="choose another"
            ) from error
        if (isinstance(error, OSError) and error.errno in FULL) or os.strerror(errno.ENOSPC) in str(error):
            raise InputError(
                f"{path}: no space left on the disk",
                fix="free some space and run the same command again; finished files are kept",
            ) from error
        raise


@contextmanager
def locked(path: Path, waiting: str = "") -> Iterator[None]:
    """Keeps other processes that want the same file or folder waiting until the block ends, or this process does.

    What is locked is a hidden file beside `path`. In a folder that is only to be read, or on a file system without
    locks, nobody waits.

    Args:
        path: need not be there.
        waiting: what to say if another process has it.

    Raises:
        InputError: a file is in the way of the folder that `path` is in.
    """
    with ExitStack() as stack:
        try:
            with plain_full_disk(path):
                path.parent.mkdir(parents=True, exist_ok=True)
                file = stack.enter_context(path.with_name(LOCK + path.name).open("a"))
            _flock(file, f"{path}: {waiting}" if waiting else "")
        except OSError as error:
            if error.errno not in LOCKLESS:
                raise
        yield


def _flock(file: IO[str], waiting: str) -> None:
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        if waiting:
            print(waiting, file=sys.stderr, flush=True)
        fcntl.flock(file, fcntl.LOCK_EX)


def write_bytes(path: Path, content: bytes) -> None:
    """Write a whole file, or leave the old one."""
    with replacing(path) as temporary:
        temporary.write_bytes(content)


def write_json(path: Path, value: Any) -> None:
    """Write `value` as indented JSON with a final newline."""
    write_bytes(path, (json.dumps(value, indent=2) + "\n").encode())


def read_json(path: Path) -> Any:
    """Read a JSON file.

    Raises:
        InputError: the file is missing or is not JSON.
    """
    try:
        return json.loads(path.read_text())
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not valid JSON", found=error, fix="restore the file or write it again") from None


def remove_tree(folder: Path) -> None:
    """Remove a folder so that an interruption leaves nothing under its name."""
    if folder.exists():
        doomed = folder.with_name(f"{PARTIAL}{os.getpid()}-{folder.name}")
        os.replace(folder, doomed)
        shutil.rmtree(doomed)


def listing(files: Iterable[Path]) -> str:
    """Twelve digits of a SHA-256 of files' names and sizes, which tells collections apart without reading them."""
    lines = sorted(f"{file.name} {file.stat().st_size}" for file in files)
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()[:12]


def sha256(path: Path) -> str:
    """Hexadecimal SHA-256 of a file's bytes."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
