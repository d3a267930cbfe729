"""Convolution of sparse noise: one copy of the kernel a seed, in a compiled loop."""

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

LANES = 16  # rows of the kernel are filled up to a multiple of it, so that vector instructions fit


@dataclass(frozen=True, eq=False)
class Seeds:
    """The pixels of a picture that are not zero, in reading order."""

    rows: NDArray[np.int64]  # [N]
    columns: NDArray[np.int64]  # [N]
    values: NDArray[np.float32]  # [N]


def convolve(seeds: Seeds, image: NDArray, width: int, height: int) -> NDArray[np.float32]:
    """Correlate a sparse picture with a kernel, mirrored at the borders without repeating the border pixel.

    The same sum as `cv2.filter2D` with its default border and anchor, in another order.

    Args:
        seeds: the picture's pixels that are not zero.
        image: the kernel [side, side].
        width: of the picture.
        height: of the picture.

    Returns:
        [H, W].
    """
    side = len(image)
    before = side - 1 - side // 2  # rows of a seed's image above the seed
    reach = side // 2  # further out a seed touches no pixel, and its image leaves the margin
    which_row, rows = _mirrored(seeds.rows, height, reach)
    which, columns = _mirrored(seeds.columns[which_row], width, reach)
    values = seeds.values[which_row][which]
    stamp = np.zeros((side, -(-side // LANES) * LANES), np.float32)
    stamp[:, :side] = image[::-1, ::-1]
    # A margin takes what falls beyond the borders.
    padded = np.zeros((height + 2 * side, width + 2 * side + LANES), np.float32)
    _add_stamps(padded, rows[which] - before + side, columns - before + side, values, stamp)
    return padded[side : side + height, side : side + width]


def _mirrored(places: NDArray[np.int64], size: int, reach: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """All mirror images of places in a row of `size` pixels, up to `reach` beyond it: (index of the place, place)."""
    period = max(1, 2 * (size - 1))
    index = np.arange(len(places))
    indices, images = [], []
    inner = (places % max(1, size - 1)) != 0  # the mirror images of a border pixel fall on its copies
    for turn in range(-(reach // period) - 1, (size + reach) // period + 2):
        for candidates, sign in ((index, 1), (index[inner], -1)):
            image = sign * places[candidates] + turn * period
            near = (image >= -reach) & (image < size + reach)
            indices.append(candidates[near])
            images.append(image[near])
    return np.concatenate(indices), np.concatenate(images)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _add_stamps(rain: NDArray, tops: NDArray, lefts: NDArray, values: NDArray, stamp: NDArray) -> None:
    """Add `stamp` times a value at each place; all of it lies inside."""
    side, length = stamp.shape
    for i in range(len(values)):
        value = values[i]
        for y in range(side):
            target, source = rain[tops[i] + y, lefts[i] : lefts[i] + length], stamp[y]
            for x in range(length):  # whole rows, zeros too: it takes long loops for vector instructions to pay
                target[x] += value * source[x]
