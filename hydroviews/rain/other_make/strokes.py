"""Strokes with soft edges and thin ends, slightly bent, drawn with anti-aliasing."""

import math

import numba
import numpy as np
from numpy.typing import NDArray

FINEST = 0.45  # standard deviation in pixels: narrower strokes are drawn this wide, and paler
REACH = 3.0  # standard deviations that are drawn

COLUMNS = ("x", "y", "to_x", "to_y", "bend", "sigma", "alpha")  # of a stroke


def draw_strokes(strokes: NDArray[np.float64], width: int, height: int) -> NDArray[np.float32]:
    """Cover [H, W] by strokes that lie over each other, 1 - prod(1 - a).

    Args:
        strokes: [N, 7], COLUMNS: both ends, how far the middle is off the line between them, and the standard deviation
            of the profile across, in pixels; the cover in the middle, 0 to 1.
        width: of the picture in pixels.
        height: of the picture in pixels.
    """
    clear = np.ones((height, width), np.float32)
    _dim(clear, np.ascontiguousarray(strokes, np.float64))
    return 1 - clear


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _dim(clear: NDArray, strokes: NDArray) -> None:
    """Multiply what is clear by 1 - a of every stroke; along rows for steep strokes, along columns for flat ones."""
    for i in range(len(strokes)):
        x, y, to_x, to_y, bend, sigma, alpha = strokes[i]
        if abs(to_y - y) >= abs(to_x - x):
            _dim_steep(clear, x, y, to_x - x, to_y - y, bend, sigma, alpha)
        else:
            _dim_steep(clear.T, y, x, to_y - y, to_x - x, -bend, sigma, alpha)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _dim_steep(
    clear: NDArray, x: float, y: float, dx: float, dy: float, bend: float, sigma: float, alpha: float
) -> None:
    """One stroke that is longer down than across."""
    height, width = clear.shape
    square = dx * dx + dy * dy
    if square < 1e-12:
        return
    length = math.sqrt(square)
    wide = math.sqrt(sigma * sigma + FINEST * FINEST)
    alpha *= sigma / wide
    half = (REACH * wide + abs(bend)) * length / abs(dy) + 1
    for row in range(max(0, math.floor(min(y, y + dy) - half)), min(height, int(max(y, y + dy) + half) + 1)):
        down = row + 0.5 - y
        middle = x + down * dx / dy
        for column in range(max(0, int(middle - half)), min(width, int(middle + half) + 1)):
            right = column + 0.5 - x
            s = (right * dx + down * dy) / square
            if 0 < s < 1:
                bow = 4 * s * (1 - s)
                off = (right * dy - down * dx) / length - bend * bow
                narrow = wide * (0.6 + 0.4 * bow)
                clear[row, column] *= 1 - alpha * bow * math.exp(-0.5 * off * off / (narrow * narrow))
