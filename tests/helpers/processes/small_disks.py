"""Disks of any size, mounted in a namespace of their own where the system lets users do that."""

import subprocess
from collections.abc import Sequence
from pathlib import Path

from hydroviews.errors import InputError

PAGE = 4096  # bytes, of which a file takes whole ones
MARGIN = 1 << 30  # bytes of the disk that is large enough
REFUSED = 99  # exit status where none can be mounted
SCRIPT = f"""
folder=$1 notes=$2 small=$3 large=$4; shift 4
mount -t tmpfs -o size="$small" tmpfs "$folder" || exit {REFUSED}
"$@" > /dev/null 2> "$notes/errors"; echo $? > "$notes/status"
mount -o remount,size="$large" tmpfs "$folder" || exit {REFUSED}
"$@" > /dev/null 2>&1
cp -a "$folder" "$notes"
"""


def twice_on_a_disk(command: Sequence[str], folder: Path, notes: Path, size: int) -> tuple[int, str]:
    """Run a command on a disk of this size, and again once the disk is large.

    Args:
        command: writes into the folder.
        folder: exists and is empty, for the command and afterwards.
        notes: gets a copy of the folder as it is in the end, under its name.
        size: in bytes.

    Returns:
        Exit status and standard error of the first time.

    Raises:
        InputError: no disk can be mounted here.
    """
    sizes = str(max(size, PAGE)), str(size + MARGIN)  # 0 would be as large as may be
    script = ["unshare", "--map-root-user", "--mount", "sh", "-c", SCRIPT, "sh", str(folder), str(notes), *sizes]
    try:
        status = subprocess.run([*script, *command], stderr=subprocess.DEVNULL).returncode
    except FileNotFoundError:
        status = REFUSED
    if not (notes / "status").is_file() or status == REFUSED:
        raise InputError("small disks cannot be mounted here")
    return int((notes / "status").read_text()), (notes / "errors").read_text()


def space_of(folder: Path) -> int:
    """Bytes that the files below a folder take, in whole pages."""
    return sum(PAGE * -(-path.stat().st_size // PAGE) for path in folder.rglob("*") if path.is_file())
