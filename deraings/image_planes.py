"""Planes of one value a pixel: at other sizes, and as weights."""

import cv2
import numpy as np
from numpy.typing import NDArray

Plane = NDArray[np.float32]  # [H, W]

WHOLE = 0.999  # of a pixel that no hidden one touches, after resizing


def resized(plane: Plane, size: tuple[int, ...]) -> Plane:
    """A plane at (height, width): averaged over areas where smaller, linear where larger."""
    if plane.shape == tuple(size):
        return plane
    smaller = size[0] < plane.shape[0] or size[1] < plane.shape[1]
    mode = cv2.INTER_AREA if smaller else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(plane, (size[1], size[0]), interpolation=mode), np.float32)


def wholly_shown(shown: Plane | None, size: tuple[int, int]) -> NDArray[np.bool_]:
    """Which pixels at (height, width) no hidden one touches; of a plane that is 1 where shown, all where it is None."""
    return np.ones(size, np.bool_) if shown is None else resized(shown, size) > WHOLE


def shown_beside(mask: NDArray[np.bool_] | None, size: tuple[int, int]) -> NDArray[np.bool_]:
    """Which pixels at (height, width) the mask of a picture, True where it hides, does not touch."""
    return wholly_shown(None if mask is None else (~mask).astype(np.float32), size)


def within_side(size: tuple[int, ...], long_side: int) -> tuple[int, int]:
    """Height and width of the same shape, the longer of which is at most `long_side`."""
    return shrunk(size, max(1.0, max(size) / long_side))


def shrunk(size: tuple[int, ...], factor: float) -> tuple[int, int]:
    """Height and width so many times smaller, at least one pixel."""
    return max(1, round(size[0] / factor)), max(1, round(size[1] / factor))


def smooth_rise(values: Plane, low: float, high: float) -> Plane:
    """A smooth rise from 0 where values are `low` to 1 where they are `high`."""
    rise = np.clip((values - np.float32(low)) / np.float32(high - low), 0, 1)
    return np.asarray(rise * rise * (3 - 2 * rise), np.float32)
