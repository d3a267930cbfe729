"""Files that are either whole or not there: write to a temporary name, then rename."""

import hashlib
import json
import os
import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from hydroviews.errors import InputError
from hydroviews.files import ownership
from hydroviews.files.full_disk import plain_write_errors
from hydroviews.files.temporary import temporary_beside


@contextmanager
def _put_in_place(path: Path) -> Iterator[Path]:
    """A temporary path beside `path`, renamed to `path` when the block ends without an exception."""
    with plain_write_errors(path), temporary_beside(path) as temporary:
        yield temporary
        os.replace(temporary, path)


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary path beside `path`, renamed to `path` when the block ends without an exception.

    The suffix is kept, so that writers which choose a format by suffix work. On an exception the temporary file is
    removed and `path` stays as it was.

    Raises:
        InputError: the disk is full.
        ReadOnly: nothing may be written there.
    """
    with _put_in_place(path) as temporary:
        yield temporary
        ownership.enter(path, temporary)


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file; an interruption leaves the old one."""
    with replacing(path) as temporary:
        temporary.write_bytes(content)


def edit_bytes(path: Path, content: bytes) -> None:
    """Write a file that was read before and whose other content is kept, whoever wrote the file."""
    with _put_in_place(path) as temporary:
        temporary.write_bytes(content)


def write_json(path: Path, value: Any) -> None:
    """Write `value` as indented JSON with a final newline."""
    write_bytes(path, json_bytes(value))


def json_bytes(value: Any) -> bytes:
    """`value` as indented JSON with a final newline."""
    return (json.dumps(value, indent=2) + "\n").encode()


def read_json(path: Path, fix: str = "restore the file or write it again") -> Any:
    """Read a JSON file, whoever wrote it.

    Args:
        path: the file.
        fix: what the user should do about one that is damaged.

    Returns:
        JSON values whose integers fit a float and whose texts can be encoded as UTF-8.

    Raises:
        InputError: the file is missing, is not JSON, or is nested too deeply.
    """
    try:
        text = as_file(path).read_text("utf-8-sig")  # some editors begin a file with a byte order mark
        value = json.loads(text, parse_int=_integer)
        if _SURROGATE.search(text):
            json.dumps(value, ensure_ascii=False).encode()
        return value
    except FileNotFoundError:  # removed meanwhile
        raise InputError(f"{path}: no such file") from None
    except (RecursionError, ValueError) as error:  # the latter for syntax, encoding and integers
        raise InputError(f"{path}: not valid JSON", found=error, fix=fix) from None


def is_there(path: Path) -> bool:
    """Whether there is a file of that name, which may be a link to one.

    Raises:
        InputError: there is something else, such as a folder or a named pipe, from which nothing would ever come.
    """
    if path.is_file():
        return True
    if path.exists():
        raise not_a_file(path)
    return False


def as_file(path: Path) -> Path:
    """The path of what is to be opened as a file; whether it is there is found out by opening it.

    Raises:
        InputError: there is something else, as `is_there`.
    """
    is_there(path)
    return path


def not_a_file(path: Path) -> InputError:
    """The error for a folder, a named pipe or the like where a file belongs."""
    kinds = {"a folder": path.is_dir, "a named pipe": path.is_fifo, "a socket": path.is_socket}
    found = next((kind for kind, is_so in kinds.items() if is_so()), "a device")
    return InputError(f"{path}: not a file", found=found, expected="a file", fix="move it away, and restore the file")


LARGEST_INTEGER = 300  # digits: floats end at 1.8e308
_SURROGATE = re.compile(r"\\u[dD][89a-fA-F]")


def _integer(digits: str) -> int:
    if len(digits) > LARGEST_INTEGER:
        raise ValueError(f"an integer of {len(digits)} digits")
    return int(digits)


def listing(files: Iterable[Path]) -> str:
    """The first 12 hexadecimal digits of the SHA-256 of the files' names and sizes; contents are not read."""
    lines = sorted(f"{file.name} {file.stat().st_size}" for file in files)
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()[:12]


def sha256(path: Path) -> str:
    """Hexadecimal SHA-256 of a file's bytes."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
