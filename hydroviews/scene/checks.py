"""What a capture from strangers may hold: the one place for the rules that every format is read by.

| what | rule | else |
|---|---|---|
| sides of a photograph or lens | 1 to LONGEST_SIDE pixels, at most MAX_PIXELS in all | refused |
| focal lengths | finite, FOCAL times the longer side | refused |
| principal point | finite, within OFF_CENTRE longer sides of the middle | refused |
| distortion | finite, nowhere folded in the undistorted picture (see `hydroviews.scene.lenses`) | refused |
| cameras | finite, rigid (see `hydroviews.formats.geometry`), within FARTHEST of the origin | refused |
| points | finite, within FARTHEST of the origin | left out, with a warning |
| colours of points | whole numbers from 0 to 255 | refused |
| file names | relative, below the capture's folder, UTF-8, at most as long as file systems have them | refused |
| views' names | UTF-8, at most VIEW_NAME bytes | refused |
| ids | each once | refused |
"""

import logging
import os.path
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hydroviews.errors import InputError

logger = logging.getLogger(__name__)

LONGEST_SIDE = 32_766  # pixels: OpenCV resamples no larger pictures
MAX_PIXELS = 250_000_000  # 4 GB at the 16 bytes a pixel that building takes
FOCAL = (0.01, 1000.0)  # of the longer side: from almost 180 degrees to a twentieth of one
OFF_CENTRE = 10.0  # longer sides: photographs may be cut out of larger ones
FARTHEST = 1e9  # scene units: float64 still tells micrometres apart there, and float32 squares do not overflow
FILE_NAME, FILE_PATH = 255, 1000  # bytes, of a part of a path and of all of it
VIEW_NAME = 150  # bytes: temporary names and suffixes make up to a hundred more of it


def check_size(where: object, width: float, height: float) -> None:
    """Refuse a picture without pixels or with more than there is memory for.

    Raises:
        InputError: a side below 1 or above LONGEST_SIDE, or more than MAX_PIXELS.
    """
    if not (min(width, height) >= 1 and max(width, height) <= LONGEST_SIDE and width * height <= MAX_PIXELS):
        raise InputError(
            f"{where}: impossible size, or too large",
            found=f"{width:g}x{height:g} pixels",
            expected=f"sides of 1 to {LONGEST_SIDE} pixels, at most {MAX_PIXELS / 1e6:g} megapixels",
            fix="make the photographs smaller, or correct the size in the camera file",
        )


def check_intrinsics(where: object, size: tuple[int, int], focal: Sequence[float], centre: Sequence[float]) -> None:
    """Refuse focal lengths and principal points, in pixels, that no camera of that size has.

    Raises:
        InputError: one is not finite or out of the module's bounds.
    """
    side = max(size)
    bad_focal = [f for f in focal if not FOCAL[0] * side <= f <= FOCAL[1] * side]
    if bad_focal:
        raise InputError(
            f"{where}: impossible focal length",
            found=f"{bad_focal[0]:g} pixels in a picture of {size[0]}x{size[1]}",
            expected=f"{FOCAL[0] * side:g} to {FOCAL[1] * side:g}",
            fix="correct the camera file, or estimate the poses again",
        )
    if not all(abs(c - s / 2) <= OFF_CENTRE * side for c, s in zip(centre, size, strict=False)):
        raise InputError(
            f"{where}: impossible principal point",
            found=f"{', '.join(f'{c:g}' for c in centre)} in a picture of {size[0]}x{size[1]}",
            fix="correct the camera file, or estimate the poses again",
        )


def check_position(where: object, position: NDArray[np.float64]) -> None:
    """Refuse a camera's position, or its translation [3], that is not finite or too far away.

    Raises:
        InputError: it is.
    """
    if not _near(position[None])[0]:
        raise InputError(
            f"{where}: the camera is impossibly far away, or its position is not finite",
            found=position.tolist(),
            expected=f"within {FARTHEST:g} units of the origin",
            fix="write the camera file again, or remove this view from it",
        )


def usable(where: object, positions: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which points [N] of positions [N, 3] are finite and not too far away; a warning says how many are not."""
    kept = _near(positions)
    if not kept.all():
        logger.warning(
            "%s: %d of %d points left out: NaN, infinite, or more than %g units from the origin",
            where, (~kept).sum(), len(kept), FARTHEST,
        )  # fmt: skip
    return kept


def _near(positions: NDArray[np.float64]) -> NDArray[np.bool_]:
    return np.asarray((np.abs(positions) <= FARTHEST).all(axis=1))  # false for NaN


def check_colours(where: object, colours: ArrayLike) -> NDArray[np.uint8]:
    """Colours of points [N, 3] as uint8.

    Raises:
        InputError: one is not a whole number from 0 to 255.
    """
    values = np.asarray(colours)
    as_bytes = np.clip(np.nan_to_num(values), 0, 255).astype(np.uint8)
    wrong = (as_bytes != values).any(axis=1)
    if wrong.any():
        raise InputError(
            f"{where}: {wrong.sum()} of {len(wrong)} points have impossible colours",
            found=values[wrong][0].tolist(),
            expected="whole numbers from 0 to 255",
            fix="write the file again",
        )
    return as_bytes


def check_file_name(where: object, name: object) -> str:
    """The name of a file in a capture's folder, as a camera file gives it.

    Raises:
        InputError: not text, not UTF-8, absolute, or leading out of the folder, or longer than a file system has it.
    """
    encoded = _encoded(where, name)
    if not encoded or b"\0" in encoded:
        raise InputError(f"{where}: not a file name", found=repr(name))
    if max(map(len, encoded.split(b"/"))) > FILE_NAME or len(encoded) > FILE_PATH:
        raise _too_long(where, encoded, f"{FILE_NAME} a folder or file, {FILE_PATH} in all")
    if encoded.startswith(b"/") or os.path.normpath(encoded).split(b"/")[0] == b"..":
        raise InputError(
            f"{where}: a name that leads out of the capture",
            found=name,
            expected="a path relative to the capture's folder, and in it",
            fix="copy the file into the capture, and correct the name in the camera file",
        )
    return str(name)


def check_view_name(where: object, name: str) -> None:
    """Refuse a view's name that no file could be given.

    Raises:
        InputError: not UTF-8, or longer than VIEW_NAME bytes.
    """
    encoded = _encoded(where, name)
    if len(encoded) > VIEW_NAME:
        raise _too_long(where, encoded, str(VIEW_NAME))


def _encoded(where: object, name: object) -> bytes:
    try:
        return name.encode() if isinstance(name, str) else b""
    except UnicodeEncodeError:
        raise InputError(
            f"{where}: a name that is not UTF-8", found=repr(name), fix="rename the file, here and in the camera file"
        ) from None


def _too_long(where: object, name: bytes, expected: str) -> InputError:
    return InputError(
        f"{where}: a name that is too long",
        found=f"{len(name)} bytes: {name[:40].decode(errors='ignore')}...",
        expected=f"at most {expected}",
        fix="rename the file, here and in the camera file",
    )


def check_once(where: object, kind: str, ids: Sequence[int]) -> None:
    """Refuse ids that are listed twice.

    Raises:
        InputError: one is.
    """
    if len(set(ids)) < len(ids):
        twice = next(number for number, following in pairwise(sorted(ids)) if number == following)
        raise InputError(
            f"{where}: {kind} {twice} is listed twice",
            expected=f"each {kind} once",
            fix="remove one of them, or estimate the poses again",
        )
