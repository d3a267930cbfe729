# Numba infers the types of kernels.
# mypy: allow-untyped-defs
"""Kernels of `rain_layer` and `streaks`: what photographs and renders differ by, along rain and along lines."""

import numpy as np
from numba import prange

from baselines.splatting.kernels.jit import kernel

BANDS = 16  # rows are shared out in as many bands, whatever the number of threads
ZERO, ONE = np.float32(0), np.float32(1)
SHORT = np.float32(1e-3)  # length of beta - B that is divided by, at least


def exercise_kernels() -> None:
    """All kernels once, on a picture of one pixel."""
    pixel, plane = np.zeros((1, 1, 3), np.float32), np.zeros((1, 1), np.float32)
    toward_rain(pixel, pixel, ONE, ONE, plane, np.empty_like(plane))
    cover(pixel, pixel, ONE, ONE, plane)
    line_sums(plane, plane, np.ones((1, 1), np.bool_), ONE, np.zeros((BANDS, 3)))


@kernel
def toward_rain(photograph, seen, brightness, left, along, length):
    """Fills `along` and `length` [H, W], see `streaks.along_rain`; `left` is 1 - S."""
    height, width = along.shape
    for row in prange(height):
        p, s, a_row, l_row = photograph[row], seen[row], along[row], length[row]
        for i in range(width):
            product, square = ZERO, ZERO
            for c in range(3):
                contrast = max(brightness - s[i, c], ZERO) / left
                product += (p[i, c] - s[i, c]) * contrast
                square += contrast * contrast
            root = np.sqrt(square)
            l_row[i] = root
            a_row[i] = product / max(root, SHORT)


@kernel
def cover(photograph, dry, brightness, least, alpha):
    """Fills alpha [H, W], see `rain_layer.alpha_between`; `least` is added to the square of the contrast."""
    height, width = alpha.shape
    for row in prange(height):
        p, d, a_row = photograph[row], dry[row], alpha[row]
        for i in range(width):
            product, square = ZERO, ZERO
            for c in range(3):
                contrast = max(brightness - d[i, c], ZERO)
                product += (p[i, c] - d[i, c]) * contrast
                square += contrast * contrast
            a_row[i] = product / (square + least)


@kernel
def line_sums(along, around, clear, limit, sums):
    """Sums [BANDS, 3] of x, x^2 and x^3 with x = along - around [h, w], cut off at +-limit, over what is `clear`."""
    height, width = along.shape
    for band in prange(BANDS):
        totals = np.zeros((3, width), np.float32)
        ones, squares, cubes = totals[0], totals[1], totals[2]
        for row in range(band * height // BANDS, (band + 1) * height // BANDS):
            a_row, b_row, c_row = along[row], around[row], clear[row]
            for i in range(width):
                x = min(max(a_row[i] - b_row[i], -limit), limit) if c_row[i] else ZERO
                ones[i] += x
                squares[i] += x * x
                cubes[i] += x * x * x
        for k in range(3):
            total = 0.0
            for i in range(width):
                total += totals[k, i]
            sums[band, k] = total
