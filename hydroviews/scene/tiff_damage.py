"""TIFFs with damage inside: OpenCV passes over what libtiff tells, and libtiff over what it can.

Strips packed by Deflate have a checksum. LZW has none, but damage leads to strings of other lengths, so that a strip
seldom decodes to as many bytes as it has pixels for. Source: TIFF 6.0, section 13.
"""

import io
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numba
import numpy as np
import PIL.Image
from numpy.typing import NDArray

LZW, DEFLATE = 5, (8, 32946)  # tag Compression
CLEAR, END, FIRST, LONGEST = 256, 257, 258, 12  # codes, and bits of the longest
WHOLE, UNKNOWN_CODE, TOO_SHORT, TOO_LONG = range(4)
FAULTS = ("", "a code that is not in the table", "fewer pixels than it has", "more pixels than it has")


def tiff_fault(path: Path) -> str:
    """The fault in the pixels of a TIFF; "" where none shows, or where the kind of TIFF is not examined."""
    content, fault = path.read_bytes(), ""
    try:
        with PIL.Image.open(io.BytesIO(content)) as picture:
            fault = next(_strip_faults(picture, content), "")
            picture.load()
    except (OSError, ValueError, SyntaxError) as error:
        return fault or str(error) or "its decoder gave up"
    return fault


def _strip_faults(picture: Any, content: bytes) -> Iterator[str]:
    """Faults of strips or tiles that are packed by LZW or Deflate."""
    tags = picture.tag_v2
    look = {LZW: _lzw_fault, **dict.fromkeys(DEFLATE, _deflate_fault)}.get(tags.get(259))
    if look is None:
        return
    kind = "tile" if 324 in tags else "strip"
    offsets, counts = (tags.get(tag, ()) for tag in ((324, 325) if kind == "tile" else (273, 279)))
    for index, (offset, count) in enumerate(zip(offsets, counts, strict=False)):
        needed, full = _bytes(tags, index)
        fault = look(content[offset : offset + count], needed, full) if needed else ""
        if fault:
            yield f"{kind} {index + 1} of {len(offsets)}: {fault}"


def _deflate_fault(data: bytes, needed: int, full: int) -> str:
    try:
        found = len(zlib.decompressobj().decompress(data))
    except zlib.error as error:
        return str(error)
    return FAULTS[TOO_SHORT if found < needed else WHOLE]


def _lzw_fault(data: bytes, needed: int, full: int) -> str:
    if data[:2] == b"\x00\x01":  # of before TIFF 6.0, with the bits the other way round
        return ""
    return FAULTS[_walk(np.frombuffer(data, np.uint8), needed, full)]


def _bytes(tags: Any, index: int) -> tuple[int, int]:
    """Decoded bytes of a strip or tile: what the picture needs, and what it may have; (0, 0) where nobody says."""
    width, height, bits = tags.get(256, 0), tags.get(257, 0), tags.get(258, (1,))
    samples = tags.get(277, 1)
    apart = tags.get(284, 1) == 2  # planes one after the other
    a_pixel = bits[0] if apart else sum(bits) * (samples if len(bits) == 1 else 1)
    if 324 in tags:
        size = (tags.get(322, 0) * a_pixel + 7) // 8 * tags.get(323, 0)
        return size, size
    rows = min(tags.get(278, height), height)
    if not rows:
        return 0, 0
    strips = -(-height // rows)
    row = (width * a_pixel + 7) // 8
    return row * min(rows, height - index % strips * rows), row * rows


@numba.njit(cache=True, nogil=True)
def _walk(data: NDArray[np.uint8], needed: int, full: int) -> int:  # pragma: no cover (compiled)
    """Follow the codes of a strip and add up the lengths of their strings; returns a fault, or WHOLE."""
    lengths = np.ones(1 << LONGEST, np.int64)
    width, following, before, total = 9, FIRST, -1, 0
    bits, n_bits = 0, 0
    for byte in data:
        bits, n_bits = (bits << 8) | int(byte), n_bits + 8
        if n_bits < width:
            continue
        n_bits -= width
        code = bits >> n_bits
        bits &= (1 << n_bits) - 1
        if code == END:
            return WHOLE if total >= needed else TOO_SHORT
        if code == CLEAR:
            width, following, before = 9, FIRST, -1
            continue
        if total >= full:
            return TOO_LONG
        if before < 0:
            if code > CLEAR:
                return UNKNOWN_CODE
            total += 1
        else:
            if code > following or following >= 1 << LONGEST:
                return UNKNOWN_CODE
            lengths[following] = lengths[before] + 1
            total += lengths[code]
            following += 1
            if following >= (1 << width) - 1 and width < LONGEST:
                width += 1
        before = code
    return WHOLE if total >= needed else TOO_SHORT
