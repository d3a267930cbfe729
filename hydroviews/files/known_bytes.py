"""Files that must hold bytes of a known SHA-256: hashed once a process, and again once they have been touched."""

import os
import stat
import time
from pathlib import Path

from hydroviews.errors import InputError
from hydroviews.files.atomic import not_a_file, sha256

SETTLED = 2e9  # nanoseconds: a file touched since could be touched again without its times telling
MEND = "restore it, or build the scene again with --repair"

_hashed: dict[Path, tuple[tuple[int, ...], str]] = {}  # what a file was like when it was hashed, and its hash


def current_sha256(path: Path) -> str:
    """Hexadecimal SHA-256 of a file as it is now; one whose size, times and inode are as before is not read again.

    Raises:
        OSError: there is no such file, or it cannot be read.
        InputError: it is something else than a file.
    """
    status = path.stat()
    if not stat.S_ISREG(status.st_mode):
        raise not_a_file(path)
    stamp = (status.st_size, status.st_mtime_ns, status.st_ctime_ns, status.st_ino)
    before, digest = _hashed.get(path, ((), ""))
    if before != stamp:
        digest = sha256(path)
        if time.time_ns() - max(status.st_mtime_ns, status.st_ctime_ns) > SETTLED:
            _hashed[path] = stamp, digest
    return digest


def require_bytes(path: Path, expected: str) -> Path:
    """The path, where its file has the SHA-256 that is expected.

    Raises:
        InputError: the file is missing, is none, or has other bytes.
    """
    try:
        found = current_sha256(path)
    except (FileNotFoundError, NotADirectoryError):
        raise InputError(f"{path}: missing", expected="a file of the data set", fix=MEND) from None
    if found != expected:
        raise changed(path, found, expected)
    return path


def changed(path: Path, found: str, expected: str) -> InputError:
    """The error for a file with other bytes than those that are known of it."""
    return InputError(
        f"{path}: changed since it was built",
        found=f"SHA-256 {found[:16]}",
        expected=f"SHA-256 {expected[:16]}, as the manifest says",
        fix=MEND,
    )


def read_only(path: Path) -> None:
    """Let nobody write into a file; who may write into its folder can still replace or remove it."""
    mode = path.stat().st_mode
    if mode & 0o222:
        os.chmod(path, mode & 0o7555)
