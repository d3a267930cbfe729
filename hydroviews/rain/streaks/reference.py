"""`recipe` step by step in float64, with every pixel of noise: slow, to compare with."""

import numpy as np
from numpy.typing import NDArray

from hydroviews.rain.streaks.recipe import PRE_BLUR, kernel, normalised


def correlate(picture: NDArray, weights: NDArray) -> NDArray[np.float64]:
    """Direct correlation [H, W] with a square kernel, borders mirrored without repeating the border pixel."""
    side, anchor = len(weights), len(weights) // 2
    height, width = picture.shape
    rows, columns = (_mirror(np.arange(size + side) - anchor, size) for size in (height, width))
    around = np.asarray(picture, np.float64)[np.ix_(rows, columns)]
    total = np.zeros((height, width))
    for y, x in np.argwhere(weights):
        total += float(weights[y, x]) * around[y : y + height, x : x + width]
    return total


def _mirror(index: NDArray[np.int64], size: int) -> NDArray[np.int64]:
    period = max(1, 2 * (size - 1))
    folded = index % period
    return np.minimum(folded, period - folded) if size > 1 else np.zeros_like(index)


def drawing(noise: NDArray, length: int, angle: float, width: int) -> NDArray[np.float64]:
    """The normalised drawing [H, W] in [0, 1] from noise of the drawing's size, before it is averaged down."""
    return np.asarray(normalised(correlate(correlate(noise, PRE_BLUR), kernel(length, angle, width))))
