# Numba infers the types of kernels.
# mypy: allow-untyped-defs
"""Kernels of what hides a share alpha [H, W] of a view: (1 - alpha) view + light instead, and the gradient back."""

import numpy as np
from numba import prange

from baselines.splatting.kernels.jit import kernel

ZERO, ONE = np.float32(0), np.float32(1)


def exercise_kernels() -> None:
    """All kernels once, on a view of one pixel."""
    pixel, plane = np.zeros((1, 1, 3), np.float32), np.zeros((1, 1), np.float32)
    behind_rain(pixel, plane, ONE, np.empty_like(pixel))
    behind_drops(pixel, plane, pixel, pixel, ZERO, ONE, np.empty_like(pixel), np.empty_like(plane))
    shade(pixel, plane, np.empty_like(pixel))


@kernel
def behind_rain(image, alpha, brightness, out):
    """A view [H, W, 3] behind rain of alpha [H, W] and encoded value `brightness`, into `out`."""
    height, width = alpha.shape
    for row in prange(height):
        a_row, behind, seen = alpha[row], image[row], out[row]
        for i in range(width):
            added, left = a_row[i] * brightness, ONE - a_row[i]
            for c in range(3):
                seen[i, c] = left * behind[i, c] + added


@kernel
def behind_drops(image, alpha, around, light, shown, hidden, out, weights):
    """A view [H, W, 3] behind drops of alpha [H, W] into `out`, and factors on its loss [H, W].

    Drops show alpha times what is `around`, and L more, `light`, [H, W, 3] each.

    The factors are 1 up to an alpha of `shown`, 0 from `hidden` on, smooth in between.
    """
    height, width = alpha.shape
    for row in prange(height):
        a_row, behind, seen, w_row = alpha[row], image[row], out[row], weights[row]
        shining, added = around[row], light[row]
        for i in range(width):
            covered, left = a_row[i], ONE - a_row[i]
            for c in range(3):
                seen[i, c] = left * behind[i, c] + covered * shining[i, c] + added[i, c]
        for i in range(width):
            fall = min(max((hidden - a_row[i]) / (hidden - shown), ZERO), ONE)
            w_row[i] = fall * fall * (np.float32(3) - np.float32(2) * fall)


@kernel
def shade(gradient, alpha, out):
    """The gradient by what is behind, [H, W, 3] into `out`, from that by what is seen: 1 - alpha times it."""
    height, width = alpha.shape
    for row in prange(height):
        a_row, given, left = alpha[row], gradient[row], out[row]
        for i in range(width):
            share = ONE - a_row[i]
            for c in range(3):
                left[i, c] = share * given[i, c]
