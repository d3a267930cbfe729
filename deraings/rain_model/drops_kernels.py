# Numba infers the types of kernels.
# mypy: allow-untyped-defs
"""Kernels of `drops`: sums over views of what every pixel of the lens shows, and the lines that follow.

A pixel's nine sums lie side by side: photograph and render, three channels each, means over channels of their product
and of the render's square, and the weights of the views that showed it: a view in which it is hidden leaves its sums as
they are.
"""

from pathlib import Path

import numpy as np
from numba import prange

from baselines.splatting.backends.warm_up import compile_apart
from baselines.splatting.kernels.jit import inlined, kernel

SUMS = 9
ZERO, ONE, THIRD = np.float32(0), np.float32(1), np.float32(1 / 3)


def warm_up() -> None:
    """Load the kernels; see `warm_up.compile_apart`."""
    compile_apart(f"from {__name__} import exercise_kernels; exercise_kernels()", [Path(__file__)])
    exercise_kernels()


def exercise_kernels() -> None:
    """Both kernels once, on a lens of one pixel."""
    pixel, sums = np.zeros((1, 1, 3), np.float32), np.zeros((1, 1, 1, SUMS), np.float32)
    add_view(pixel, pixel, np.ones((1, 1), np.bool_), ONE, ONE, sums[0])
    fit_lines(sums, np.ones(1, np.float32), ONE, ZERO, ONE, np.empty((1, 1), np.float32), pixel)


@kernel
def add_view(photograph, seen, shown, keep, weight, sums):
    """Where shown [h, w], sums [h, w, 9] become keep sums + weight times those of one view, [h, w, 3] each."""
    height, width = sums.shape[0], sums.shape[1]
    for row in prange(height):
        for i in range(width):
            if not shown[row, i]:
                continue
            product, square = ZERO, ZERO
            for c in range(3):
                p, s = photograph[row, i, c], seen[row, i, c]
                sums[row, i, c] = keep * sums[row, i, c] + weight * p
                sums[row, i, 3 + c] = keep * sums[row, i, 3 + c] + weight * s
                product += p * s
                square += s * s
            sums[row, i, 6] = keep * sums[row, i, 6] + weight * THIRD * product
            sums[row, i, 7] = keep * sums[row, i, 7] + weight * THIRD * square
            sums[row, i, 8] = keep * sums[row, i, 8] + weight


@inlined
def step(value, low, high):
    """A smooth rise from 0 at `low` to 1 at `high`."""
    rise = min(max((value - low) / (high - low), ZERO), ONE)
    return rise * rise * (np.float32(3) - np.float32(2) * rise)


@kernel
def fit_lines(sums, weights, noise, clear, wet, alpha, light):
    """Fills alpha [h, w] and light L [h, w, 3] from sums [T, h, w, 9], those of the times weighed by weights [T].

    Both are 0 where no view showed anything.
    """
    times, height, width = sums.shape[0], sums.shape[1], sums.shape[2]
    for row in prange(height):
        mean = np.zeros(SUMS, np.float32)
        for i in range(width):
            mean[:] = ZERO
            for time in range(times):
                if weights[time] > 0:
                    for k in range(SUMS):
                        mean[k] += weights[time] * sums[time, row, i, k]
            if mean[8] <= ZERO:
                alpha[row, i] = ZERO
                light[row, i, :] = ZERO
                continue
            mean /= mean[8]
            together, alone = mean[6], mean[7]
            for c in range(3):
                together -= THIRD * mean[c] * mean[3 + c]
                alone -= THIRD * mean[3 + c] * mean[3 + c]
            lost = ONE - (together + noise * noise) / (max(alone, ZERO) + noise * noise)
            m = min(max(lost, ZERO), ONE) * step(lost, clear, wet)
            alpha[row, i] = m
            for c in range(3):
                light[row, i, c] = min(max(mean[c] - (ONE - m) * mean[3 + c], ZERO), m)
