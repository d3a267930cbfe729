# Numba infers the types of kernels, and calls what is defined here with its own.
# mypy: allow-untyped-defs, allow-untyped-calls
"""L1, SSIM and the gradient of both in one sweep down the image, which keeps no more rows than it still needs.

The image is cut into parts: bands of rows, and strips of columns. Down each of them, four rows at a time, go

    1. x, y, and above GREY: x, y, x^2 + y^2 and x y                   down to row r
    2. these filtered, down and along; SSIM and its derivatives        down to row r - 5
    3. the derivatives filtered, down and along; the gradient          down to row r - 9

Rings keep sixteen rows of 1 and 2, few enough to stay in the processor's cache. Rows and columns beside a part that
its windows reach into are calculated twice: parts share nothing, so results do not depend on the number of threads.

Variances are differences, E[x^2] - E[x]^2, that cancel. Above GREY most squares are much smaller, and so is what
rounding leaves of them. The taps add up to exactly 1, or a part of the mean would be taken for variance.
"""

import numpy as np
from numba import prange
from numba.core import cgutils, types

from baselines.splatting.kernels.jit import exact_kernel, inlined
from baselines.splatting.kernels.vector_memory import address, aligned, load, store
from baselines.splatting.kernels.vectors import FLOATS, LANES, absolute, intrinsic, llvm_type, select

RADIUS = 5
SIGMA = 1.5
_WINDOW = np.exp(-(np.arange(RADIUS + 1) ** 2) / (2 * SIGMA**2))  # at distance 0 to 5
_TAPS = np.round(_WINDOW[1:] / (2 * _WINDOW[1:].sum() + 1) * 2**24) / 2**24
T1, T2, T3, T4, T5 = (np.float32(tap) for tap in _TAPS)
T0 = np.float32(1 - 2 * _TAPS.sum())
C1, C2 = np.float32(0.01**2), np.float32(0.03**2)
NONE, ONE, TWO, GREY = np.float32(0), np.float32(1), np.float32(2), np.float32(0.25)
FULL = np.float32(255)  # what stands for 1 in a target

BAND, STRIP = 160, 384  # rows and columns of a part at most; a pixel has three columns
GROUP, RING = 4, 16  # rows at a time, and rows kept: whole groups, and all that the windows of a group need
READ = 12  # rows read above and below a band: the windows of windows reach ten, in whole groups
MARGIN = 16  # columns on each side that a window reaches into: 15, in whole vectors
WIDE = STRIP + 4 * MARGIN  # columns of all rows kept; the first is 2 MARGIN to the left of the strip
X, Y, ABOVE, PLANES = 0, 1, 2, 6  # planes of a ring: two as they are, and four above GREY
ALONG = tuple(range(-3 * RADIUS, 3 * RADIUS + 1, 3))  # a step of three leads to the same channel of the next pixel


@intrinsic
def load_each(typingctx, array, places, index):
    """A tuple: LANES numbers from each of some places in an array, as seen from index."""
    kind = types.UniTuple(FLOATS, places.count)

    def generate(context, builder, sig, args):
        values = []
        for place in cgutils.unpack_tuple(builder, args[1]):
            at = builder.add(args[2], place)
            values.append(builder.load(address(context, builder, llvm_type(FLOATS), array, args[0], at)))
            values[-1].align = 4
        return context.make_tuple(builder, kind, values)

    return kind(array, places, types.int64), generate


@inlined
def window(v):
    """The weighted sum of eleven."""
    outer = T5 * (v[0] + v[10]) + T4 * (v[1] + v[9]) + T3 * (v[2] + v[8])
    return outer + T2 * (v[3] + v[7]) + T1 * (v[4] + v[6]) + T0 * v[5]


@inlined
def rows_below(row, size):
    """Where the fourteen rows of a ring from `row` on begin: those that the windows of a group need."""
    r = row
    return (
        (r & 15) * size, (r + 1 & 15) * size, (r + 2 & 15) * size, (r + 3 & 15) * size, (r + 4 & 15) * size,
        (r + 5 & 15) * size, (r + 6 & 15) * size, (r + 7 & 15) * size, (r + 8 & 15) * size, (r + 9 & 15) * size,
        (r + 10 & 15) * size, (r + 11 & 15) * size, (r + 12 & 15) * size, (r + 13 & 15) * size,
    )  # fmt: skip


@inlined
def filter_down(ring, rows, first, planes, start, end, out):
    """The windows of a group, of the planes of a ring from `first` on, in the columns [start, end)."""
    for q in range(planes):
        for i in range(start, end, LANES):
            v = load_each(ring, rows, (first + q) * WIDE + i)
            store(window(v[0:11]), out, q * WIDE + i)
            store(window(v[1:12]), out, (planes + q) * WIDE + i)
            store(window(v[2:13]), out, (2 * planes + q) * WIDE + i)
            store(window(v[3:14]), out, (3 * planes + q) * WIDE + i)


@inlined
def similarity(mean_x, mean_y, squares, product):
    """SSIM, and its derivatives by the means of x, x^2 and x y; all above GREY, where `squares` is of x^2 + y^2."""
    x, y = mean_x + GREY, mean_y + GREY
    a1, a2 = TWO * x * y + C1, TWO * (product - mean_x * mean_y) + C2
    b1, b2 = x * x + y * y + C1, (squares - mean_x * mean_x - mean_y * mean_y) + C2
    inverse = ONE / (b1 * b2)
    ssim = a1 * a2 * inverse
    by_product = TWO * a1 * inverse
    by_square = -ssim * b1 * inverse
    by_mean = TWO * (y * a2 - x * ssim * b2) * inverse - mean_y * by_product - TWO * mean_x * by_square
    return ssim, by_mean, by_square, by_product


@inlined
def read_row(x, y, ignored, row, left, ring, at):
    """The planes of a row from column `left` on, into a ring at `at`; x and y are 0 outside, and where hidden."""
    height, n = x.shape
    for i in range(2 * WIDE):
        ring[at + i] = NONE
    if 0 <= row < height:
        first, last = max(0, left), min(n, left + WIDE)
        from_x, from_y = x[row, first:last], y[row, first:last]
        to_x, to_y = ring[at + first - left : at + WIDE], ring[at + WIDE + first - left : at + 2 * WIDE]
        for i in range(last - first):
            to_x[i] = from_x[i]
        for i in range(last - first):
            to_y[i] = np.float32(from_y[i]) / FULL
        if ignored.shape[0] > 0:
            for i in range(last - first):
                if ignored[row, (first + i) // 3]:
                    to_x[i] = to_y[i] = NONE
    for i in range(at, at + WIDE, LANES):
        a, b = load(ring, i) - GREY, load(ring, i + WIDE) - GREY
        store(a, ring, i + ABOVE * WIDE)
        store(b, ring, i + (ABOVE + 1) * WIDE)
        store(a * a + b * b, ring, i + (ABOVE + 2) * WIDE)
        store(a * b, ring, i + (ABOVE + 3) * WIDE)


@inlined
def read_factors(weights, ignored, row, left, n, factors):
    """What the columns of a row from `left` on count; 0 outside, and where hidden. `left` begins a pixel."""
    for pixel in range(max(0, left // 3), min(n, left + WIDE + 2) // 3):
        factor = weights[row, pixel] if weights.shape[0] > 0 else ONE
        if ignored.shape[0] > 0 and ignored[row, pixel]:
            factor = NONE
        i = 3 * pixel - left
        factors[i] = factors[i + 1] = factors[i + 2] = factor


@inlined
def compare_row(ring, at, means, to_mean, factors, shares, end, slopes, to, losses):
    """The losses of a row, and the derivatives of its SSIM; both as they count."""
    for i in range(MARGIN, end + MARGIN, LANES):
        m = to_mean + i
        mean_x, mean_y = window(load_each(means, ALONG, m)), window(load_each(means, ALONG, m + WIDE))
        squares = window(load_each(means, ALONG, m + 2 * WIDE))
        product = window(load_each(means, ALONG, m + 3 * WIDE))
        ssim, by_mean, by_square, by_product = similarity(mean_x, mean_y, squares, product)
        factor = load(factors, i + 1)
        store(factor * by_mean, slopes, to + i)
        store(factor * by_square, slopes, to + WIDE + i)
        store(factor * by_product, slopes, to + 2 * WIDE + i)
        l1 = absolute(load(ring, at + i) - load(ring, at + WIDE + i))
        store(factor * (shares[0] * l1 + shares[1] * (ONE - ssim)), losses, i)


@inlined
def gradient_row(ring, at, means, to_mean, factors, shares, end, out):
    """The gradient in a row, from the filtered derivatives of its SSIM."""
    for i in range(2 * MARGIN, end, LANES):
        m = to_mean + i
        by_mean, by_square = window(load_each(means, ALONG, m)), window(load_each(means, ALONG, m + WIDE))
        by_product = window(load_each(means, ALONG, m + 2 * WIDE))
        x, y = load(ring, at + i), load(ring, at + WIDE + i)
        sign = select(x > y, ONE, select(x < y, -ONE, NONE))
        by_ssim = by_mean + TWO * (x - GREY) * by_square + (y - GREY) * by_product
        store(load(factors, i + 1) * (shares[0] * sign) - shares[1] * by_ssim, out, i)


@exact_kernel
def sweep(x, y, ignored, weights, share, sums, losses, gradient):
    """The loss of a render, of each pixel and in all, and its gradient.

    Args:
        x: the render [H, 3 W], channels interleaved.
        y: the target [H, 3 W], 8 bits.
        ignored: bool [H, W], what is hidden; [0, 0] for nothing.
        weights: [H, W] per pixel; [0, 0] for one everywhere.
        share: lambda.
        sums: output [bands, strips], the sum over the pixels and channels of each part.
        losses: output [H, W], averaged over channels; [0, 0] leaves it out.
        gradient: output [H, 3 W], of the average over pixels and channels; [0, 0] leaves it out.
    """
    height, n = x.shape
    bands, strips = sums.shape
    for part in prange(bands * strips):
        band, start = part // strips, part % strips * STRIP
        first, last = band * height // bands, (band + 1) * height // bands
        columns = min(STRIP, n - start)
        left, end = start - 2 * MARGIN, 2 * MARGIN + (columns + MARGIN - 1) // MARGIN * MARGIN
        ring, slopes = aligned(RING * PLANES * WIDE), aligned(RING * 3 * WIDE)
        means, row_losses = aligned(GROUP * 4 * WIDE), aligned(WIDE)
        factors = np.zeros(WIDE + 3, np.float32)
        shares = np.float32(1 - share), np.float32(share)
        averaged = np.float32((1 - share) / (height * n)), np.float32(share / (height * n))
        varying = weights.shape[0] > 0 or ignored.shape[0] > 0
        read_factors(weights, ignored, first, left - 1, n, factors)
        totals = np.zeros(STRIP)
        for top in range(first - READ, last + READ, GROUP):
            newest = top - first + RING  # rows of rings are counted from the band's first on
            for k in range(GROUP):
                read_row(x, y, ignored, top + k, left, ring, (newest + k & 15) * PLANES * WIDE)
            if top < first:
                continue
            filter_down(ring, rows_below(newest - 10, PLANES * WIDE), ABOVE, 4, 0, end + 2 * MARGIN, means)
            for k in range(GROUP):
                row, to = top + k - RADIUS, (newest + k - RADIUS & 15) * 3 * WIDE
                if row < 0 or row >= height:
                    slopes[to : to + 3 * WIDE] = NONE
                    continue
                if varying:
                    read_factors(weights, ignored, row, left - 1, n, factors)
                at = (newest + k - RADIUS & 15) * PLANES * WIDE
                compare_row(ring, at, means, k * 4 * WIDE, factors, shares, end, slopes, to, row_losses)
                if first <= row < last:
                    inside = row_losses[2 * MARGIN : 2 * MARGIN + columns]
                    for i in range(columns):
                        totals[i] += inside[i]
                    if losses.shape[0] > 0:
                        for i in range(0, columns, 3):
                            losses[row, (start + i) // 3] = (inside[i] + inside[i + 1] + inside[i + 2]) / np.float32(3)
            if gradient.shape[0] == 0 or top < first + READ:
                continue
            filter_down(slopes, rows_below(newest - READ - RADIUS, 3 * WIDE), 0, 3, MARGIN, end + MARGIN, means)
            for k in range(min(GROUP, last + READ - top)):
                row, at = top - READ + k, (newest - READ + k & 15) * PLANES * WIDE
                if varying:
                    read_factors(weights, ignored, row, left - 1, n, factors)
                gradient_row(ring, at, means, k * 3 * WIDE, factors, averaged, end, row_losses)
                to_row, from_row = gradient[row, start : start + columns], row_losses[2 * MARGIN :]
                for i in range(columns):
                    to_row[i] = from_row[i]
                if ignored.shape[0] > 0:
                    for i in range(columns):
                        if ignored[row, (start + i) // 3]:
                            to_row[i] = NONE
        sums[band, start // STRIP] = totals.sum()
