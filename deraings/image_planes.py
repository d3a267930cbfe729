"""Planes of one value a pixel: at other sizes, and as weights; the light around each pixel."""

from functools import cache
from typing import TYPE_CHECKING, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from hydroviews.scene.images import Image

if TYPE_CHECKING:
    from torch import Tensor

Plane = NDArray[np.float32]  # [H, W]
Factors = TypeVar("Factors", Plane, "Tensor")

WHOLE = 0.999  # of a pixel that no hidden one touches, after resizing
CELLS = 40  # along the longer side, of which the light around pixels is taken
AROUND = 5  # cells on each side


def product(*parts: Factors | None) -> Factors | None:
    """The product of planes [H, W]; None stands for one that is 1 everywhere."""
    product: Factors | None = None
    for part in parts:
        if part is not None:
            product = part if product is None else product * part
    return product


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


def surroundings(image: Image) -> Image:
    """The light around each pixel [H, W, 3]: means over squares of a quarter of the longer side, cut at edges."""
    height, width = image.shape[:2]
    cells = within_side((height, width), CELLS)
    small = cv2.resize(image, cells[::-1], interpolation=cv2.INTER_AREA)
    columns = (averages_around(cells[0]) @ small.reshape(cells[0], -1)).reshape(small.shape)
    around = averages_around(cells[1]) @ columns
    return np.asarray(cv2.resize(around, (width, height), interpolation=cv2.INTER_LINEAR), np.float32)


@cache
def averages_around(cells: int) -> NDArray[np.float32]:
    """What each cell of a line takes of each for the mean of those around it [cells, cells], not to be written to."""
    near = np.abs(np.subtract.outer(np.arange(cells), np.arange(cells))) <= AROUND
    weights = (near / near.sum(axis=1, keepdims=True)).astype(np.float32)
    weights.flags.writeable = False
    return weights
