"""Photographs with damage inside: a decoder warns and goes on with grey or shifted blocks, which is no photograph.

JPEGs and TIFFs are looked at; other formats have checksums. libjpeg writes its warnings to standard error, where OpenCV
leaves them, and Pillow keeps some of them to itself. So JPEGs are decoded once in a process of its own, small and grey,
which takes a fraction of the time, and what it writes there is read. `tiff_damage` looks at TIFFs in that process.
"""

import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import IO

import cv2
import numpy as np
from tqdm import tqdm

from hydroviews.cli.processes import deferred_interrupts
from hydroviews.errors import InputError

START = b"\xff\xd8\xff"  # of every JPEG
STARTS = {START: "JPEG", b"II*\0": "TIFF", b"MM\0*": "TIFF"}
DAMAGE = ("Corrupt JPEG data", "Premature end of JPEG")  # libjpeg's other warnings are of no consequence
PADDING = re.compile(r"Corrupt JPEG data: (\d+) extraneous bytes before marker (0xd[0-79])")
STRAY = 9  # bytes: what some cameras leave before a marker, and what the decoder had read ahead
ZEROS = re.compile(rb"\x00{2,}(\xff[\xd0-\xd7\xd9])")  # one may be data
END, RESTART = 0xD9, re.compile(rb"\xff([\xd0-\xd7])")  # markers


def require_whole(paths: Sequence[Path], title: str) -> None:
    """Refuse JPEGs and TIFFs that are damaged; files of other formats, and missing ones, are left to their reader.

    Args:
        paths: of photographs.
        title: of the progress bar.

    Raises:
        InputError: it names the first damaged one, and how many there are.
    """
    looked_at = [path for path in paths if path.is_file() and _format(path)]
    if not looked_at:
        return
    answers = tqdm(_warnings(looked_at), desc=title, unit="view", total=len(looked_at), leave=False)
    damaged = [(path, found) for path, found in zip(looked_at, answers, strict=True) if found]
    if damaged:
        path, found = damaged[0]
        more = f", and {len(damaged) - 1} more photographs" if len(damaged) > 1 else ""
        raise InputError(
            f"{path}: a damaged {_format(path)}{more}",
            found=found,
            expected="a photograph that decodes without a warning",
            fix="copy it again, or leave it out",
        )


def _format(path: Path) -> str:
    """JPEG, TIFF, or "" for others, by how the file begins."""
    with path.open("rb") as file:
        begins = file.read(max(map(len, STARTS)))
    return next((name for start, name in STARTS.items() if begins.startswith(start)), "")


def _warnings(paths: Sequence[Path]) -> Iterator[str]:
    """The first warning that tells of damage, for each photograph; "" where there is none."""
    with deferred_interrupts():  # it is killed below
        command = [sys.executable, "-m", __name__]
        process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert process.stdin is not None
    assert process.stdout is not None
    answered = 0
    try:
        with process.stdin:
            json.dump([str(path) for path in paths], process.stdin)
        for line in process.stdout:
            answered += 1
            yield next(iter(json.loads(line)), "")
    finally:
        process.kill()
        process.stdout.close()
        process.wait()
    if answered < len(paths):
        raise InputError(
            f"{paths[answered]}: a damaged {_format(paths[answered])}", found="its decoder crashed", fix="copy it again"
        )


def _tells_damage(path: Path, said: str) -> bool:
    return said.startswith(DAMAGE) and not _is_padded(path, said)


def _is_padded(path: Path, said: str) -> bool:
    """Whether a few bytes that a decoder passed over before a marker are of no consequence.

    Before the end mark nothing can be lost. Before restart marks, these have to follow each other without a gap: zeros
    in the place of a lost sector are no padding.
    """
    told = PADDING.fullmatch(said)
    if not told or int(told[1]) > STRAY:
        return False
    order = [found[1][0] & 7 for found in RESTART.finditer(path.read_bytes())]
    return int(told[2], 16) == END or all(b == (a + 1) % 8 for a, b in pairwise(order))


def main() -> None:
    """Decode the photographs that standard input lists; a line for each, with what tells of damage."""
    paths = [Path(path) for path in json.load(sys.stdin)]
    with tempfile.TemporaryFile() as written:
        os.dup2(written.fileno(), sys.stderr.fileno())
        for path in paths:
            faults = _jpeg_faults(path, written) if _format(path) == "JPEG" else _tiff_faults(path)
            print(json.dumps(list(filter(None, faults))), flush=True)


def _tiff_faults(path: Path) -> list[str]:
    from hydroviews.scene.tiff_damage import tiff_fault  # Numba comes with it

    return [tiff_fault(path)]


def _jpeg_faults(path: Path, written: IO[bytes]) -> list[str]:
    """The warnings of damage that libjpeg writes to standard error while a JPEG is decoded.

    One with padding before a marker is decoded without it: zeros that stand for lost data are missed then, padding is
    not.
    """
    content = np.fromfile(path, np.uint8).tobytes()
    said = _decoded(content, written)
    if said and PADDING.fullmatch(said[0]):
        said = _decoded(ZEROS.sub(rb"\0\1", content), written)
    return [line for line in said if _tells_damage(path, line)]


def _decoded(content: bytes, written: IO[bytes]) -> list[str]:
    """The warnings that libjpeg writes of a picture."""
    written.truncate(0)
    written.seek(0)
    cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_REDUCED_GRAYSCALE_8)
    written.seek(0)
    return written.read().decode(errors="replace").splitlines()


if __name__ == "__main__":
    main()
