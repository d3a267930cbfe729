"""One error for a full disk, whichever library meets it, and one for a disk that may not be written."""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from hydroviews.errors import InputError, MachineError

FULL = (errno.ENOSPC, errno.EDQUOT)
SAID = (os.strerror(errno.ENOSPC), "database or disk is full", "disk I/O error")  # the last two by SQLite
CLOSED = (errno.EACCES, errno.EPERM, errno.EROFS)


class ReadOnly(MachineError):
    """Nothing may be written there."""


class FullDisk(MachineError):
    """There is no space left, on the disk or in the user's quota."""


@contextmanager
def plain_full_disk(path: Path) -> Iterator[None]:
    """Turn the error of a full disk, in whatever form a library raises it, into one that says what to do.

    Args:
        path: the file or folder that is written in the block.

    Raises:
        FullDisk: the disk or the user's quota is full.
        InputError: a file is in the way of the folder of `path`, or it cannot be made; a folder is in that of `path`.
    """
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        if isinstance(error, NotADirectoryError | FileExistsError):
            raise InputError(
                f"{path.parent}: not a folder", found="a file of that name", fix="choose another"
            ) from error
        if isinstance(error, IsADirectoryError):
            raise InputError(f"{path}: cannot be written", found="a folder of that name", fix="move it away") from error
        if isinstance(error, FileNotFoundError) and not path.parent.is_dir():  # as under /proc
            raise InputError(f"{path.parent}: no folder can be made there", fix="choose another folder") from error
        if (isinstance(error, OSError) and error.errno in FULL) or any(said in str(error) for said in SAID):
            raise FullDisk(
                f"{path}: no space left on the disk",
                found=error,
                fix="free some space and run the same command again; finished files are kept",
            ) from error
        raise


@contextmanager
def plain_write_errors(path: Path) -> Iterator[None]:
    """Turn the errors of writing a file or folder that a user can mend into ones that say what to do.

    Raises:
        InputError: as `plain_full_disk`.
        ReadOnly: nothing may be written there.
    """
    with plain_full_disk(path):
        try:
            yield
        except OSError as error:
            if error.errno not in CLOSED:
                raise
            raise ReadOnly(f"{path}: cannot be written", found=error.strerror, fix="choose another folder") from error
