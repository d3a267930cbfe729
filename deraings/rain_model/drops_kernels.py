# Numba infers the types of kernels.
# mypy: allow-untyped-defs
"""Kernels of `drops`: sums over views of what every pixel of the lens shows, the lines that follow.

Of each pixel there are nine sums: photograph and render, three channels each, both less the light around the pixel,
means over channels of their product and of the render's square, and the weights of the views that showed it: a view in
which it is hidden leaves its sums as they are. A row's sums lie together, one after another [9, w], and a loop does one
thing to a few of them, so that a processor does it to many pixels at once.
"""

import numpy as np
from numba import prange

from baselines.splatting.kernels.jit import inlined, kernel

SUMS = 9
PRODUCT, SQUARE, SEEN = 6, 7, 8  # of the sums, after photograph and render
BANDS = 16  # rows are shared out in as many bands, whatever the number of threads
ZERO, ONE, THIRD = np.float32(0), np.float32(1), np.float32(1 / 3)
LEAST = np.float32(1e-20)  # a sum of weights that is divided by; where it is 0 so are the other sums


def exercise_kernels() -> None:
    """All kernels once, on a lens of one pixel."""
    pixel, plane = np.zeros((1, 1, 3), np.float32), np.zeros((1, 1), np.float32)
    sums = np.zeros((1, 1, SUMS, 1), np.float32)
    add_view(pixel, pixel, pixel, np.ones((1, 1), np.bool_), ONE, ONE, sums[0])
    fit_lines(sums, np.ones(1, np.float32), plane.copy(), ONE, ZERO, ONE, plane, pixel)


@inlined
def split_differences(row, less, planes):
    """What two rows of pixels [w, 3] differ by, as planes [3, w]."""
    red, green, blue = planes[0], planes[1], planes[2]
    for i in range(row.shape[0]):
        red[i], green[i], blue[i] = row[i, 0] - less[i, 0], row[i, 1] - less[i, 1], row[i, 2] - less[i, 2]


@inlined
def remember(keep, weight, values, sums):
    """Sums [w] become keep sums + weight values."""
    for i in range(sums.shape[0]):
        sums[i] = keep[i] * sums[i] + weight[i] * values[i]


@inlined
def mean_product(a, b, out):
    """Mean over the channels of the product of two rows in planes [3, w]."""
    a0, a1, a2, b0, b1, b2 = a[0], a[1], a[2], b[0], b[1], b[2]
    for i in range(out.shape[0]):
        out[i] = THIRD * (a0[i] * b0[i] + a1[i] * b1[i] + a2[i] * b2[i])


@kernel
def add_view(photograph, seen, around, shown, keep, weight, sums):
    """Where shown [h, w], sums [h, 9, w] become keep sums + weight times those of one view, [h, w, 3] each."""
    height, width = sums.shape[0], sums.shape[2]
    for band in prange(BANDS):
        pixels, keeps, weights = (
            np.empty((SUMS, width), np.float32),
            np.empty(width, np.float32),
            np.empty(width, np.float32),
        )
        pixels[SEEN] = ONE
        for row in range(band * height // BANDS, (band + 1) * height // BANDS):
            split_differences(photograph[row], around[row], pixels[:3])
            split_differences(seen[row], around[row], pixels[3:6])
            mean_product(pixels[:3], pixels[3:6], pixels[PRODUCT])
            mean_product(pixels[3:6], pixels[3:6], pixels[SQUARE])
            shown_row = shown[row]
            for i in range(width):
                keeps[i] = keep if shown_row[i] else ONE
                weights[i] = weight if shown_row[i] else ZERO
            for k in range(SUMS):
                remember(keeps, weights, pixels[k], sums[row, k])


@inlined
def step(value, low, high):
    """A smooth rise from 0 at `low` to 1 at `high`."""
    rise = min(max((value - low) / (high - low), ZERO), ONE)
    return rise * rise * (np.float32(3) - np.float32(2) * rise)


@inlined
def average_times(sums, weights, row, mean):
    """A row's sums [9, w] at the times that are weighed by weights [T], then over all that is known: means."""
    mean[:] = ZERO
    for time in range(sums.shape[0]):
        weight = weights[time]
        if weight > ZERO:
            for k in range(SUMS):
                values, out = sums[time, row, k], mean[k]
                for i in range(values.shape[0]):
                    out[i] += weight * values[i]
    seen = mean[SEEN]
    for k in range(SEEN):
        out = mean[k]
        for i in range(seen.shape[0]):
            out[i] *= ONE / max(seen[i], LEAST)


@inlined
def add_light(mean, alpha, light):
    """L [w, 3] of a row from its means [9, w] and alpha [w]."""
    p0, p1, p2, r0, r1, r2 = mean[0], mean[1], mean[2], mean[3], mean[4], mean[5]
    for i in range(alpha.shape[0]):
        m = alpha[i]
        left = ONE - m
        light[i, 0] = min(max(p0[i] - left * r0[i], -m), m)
        light[i, 1] = min(max(p1[i] - left * r1[i], -m), m)
        light[i, 2] = min(max(p2[i] - left * r2[i], -m), m)


@kernel
def fit_lines(sums, weights, believed, noise, clear, wet, alpha, light):
    """Fills alpha [h, w] and light L [h, w, 3] from sums [T, h, 9, w], those of the times weighed by weights [T].

    alpha is as much of what the slope says as is believed [h, w]. Both are 0 where no view showed anything.
    """
    height, width = sums.shape[1], sums.shape[3]
    for band in prange(BANDS):
        mean, products = np.empty((SUMS, width), np.float32), np.empty((2, width), np.float32)
        for row in range(band * height // BANDS, (band + 1) * height // BANDS):
            average_times(sums, weights, row, mean)
            mean_product(mean[:3], mean[3:6], products[0])
            mean_product(mean[3:6], mean[3:6], products[1])
            together, alone, seen, a_row = products[0], products[1], mean[SEEN], alpha[row]
            product, square = mean[PRODUCT], mean[SQUARE]
            for i in range(width):
                covariance, variance = product[i] - together[i], max(square[i] - alone[i], ZERO)
                lost = ONE - (covariance + noise * noise) / (variance + noise * noise)
                m = min(max(lost, ZERO), ONE) * step(lost, clear, wet) * believed[row, i]
                a_row[i] = m if seen[i] > ZERO else ZERO
            add_light(mean, a_row, light[row])
