# Numba infers the types of kernels, and calls what is defined here with its own.
# mypy: allow-untyped-defs, allow-untyped-calls
"""L1, SSIM and the gradient of both in one sweep down the image, which keeps no more rows than it still needs.

The image is cut into parts: bands of rows, and strips of columns. Down each of them, four rows at a time, go

    1. x, y, and above GREY: x, y, x^2 + y^2 and x y                   down to row r
    2. these filtered, down and along; SSIM and its derivatives        down to row r - 5
    3. the derivatives filtered, down and along; the gradient          down to row r - 9

Where pixels have weights w, windows are weighted averages: w, and products with w, are filtered. What lies outside the
image is 0 and weighs as the inside of a window does on average; see `photometric.py`.

Rings keep sixteen rows of 1 and 2, few enough to stay in the processor's cache. Rows and columns beside a part that
its windows reach into are calculated twice: parts share nothing, so results do not depend on the number of threads.

Variances are differences, E[x^2] - E[x]^2, that cancel. Above GREY most squares are much smaller, and so is what
rounding leaves of them. The taps add up to exactly 1, or a part of the mean would be taken for variance.
"""

import numpy as np
from numba import prange
from numba.core import cgutils, types

from baselines.splatting.kernels.jit import exact_kernel, inlined
from baselines.splatting.kernels.vector.memory import address, aligned, load, spread, store
from baselines.splatting.kernels.vector.vectors import FLOATS, LANES, absolute, intrinsic, llvm_type, maximum, select

RADIUS = 5
SIGMA = 1.5
_WINDOW = np.exp(-(np.arange(RADIUS + 1) ** 2) / (2 * SIGMA**2))  # at distance 0 to 5
_TAPS = np.round(_WINDOW[1:] / (2 * _WINDOW[1:].sum() + 1) * 2**24) / 2**24
T1, T2, T3, T4, T5 = (np.float32(tap) for tap in _TAPS)
T0 = np.float32(1 - 2 * _TAPS.sum())
BEYOND = np.array([_TAPS[distance:].sum() for distance in range(RADIUS + 1)], np.float32)  # taps farther than 0 to 5
C1, C2 = np.float32(0.01**2), np.float32(0.03**2)
NONE, ONE, TWO, GREY = np.float32(0), np.float32(1), np.float32(2), np.float32(0.25)
FULL = np.float32(255)  # what stands for 1 in a target
FAINT = np.float32(1e-30)  # windows whose weight is as little are divided by it, so that nothing becomes infinite

BAND, STRIP = 160, 384  # rows and columns of a part at most; a pixel has three columns
GROUP, RING = 4, 16  # rows at a time, and rows kept: whole groups, and all that the windows of a group need
READ = 12  # rows read above and below a band: the windows of windows reach ten, in whole groups
MARGIN = 16  # columns on each side that a window reaches into: 15, in whole vectors
WIDE = STRIP + 4 * MARGIN  # columns of all rows kept; the first is 2 MARGIN to the left of the strip
X, Y, ABOVE, WEIGHT = 0, 1, 2, 6  # planes of a ring: two as they are, four above GREY, and weights where there are
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
def part_inside(place, size):
    """How much of a window around a place lies inside, along an axis."""
    return ONE - BEYOND[min(place, RADIUS)] - BEYOND[min(size - 1 - place, RADIUS)]


@inlined
def read_inside(left, n, inside, windows):
    """1 in the columns inside, else 0; and how much of their windows lies inside. `left` begins a pixel."""
    for pixel in range(max(0, left // 3), min(n, left + WIDE + 2) // 3):
        i = 3 * pixel - left
        inside[i] = inside[i + 1] = inside[i + 2] = ONE
        windows[i] = windows[i + 1] = windows[i + 2] = part_inside(pixel, n // 3)


@inlined
def read_weights(weights, ignored, row, left, n, out):
    """The weights of the columns of a row, 0 where hidden; those outside stay. `left` begins a pixel."""
    for pixel in range(max(0, left // 3), min(n, left + WIDE + 2) // 3):
        weight = max(weights[row, pixel], NONE) if weights.shape[0] > 0 else ONE  # rounding leaves -1e-7 of some
        if ignored.shape[0] > 0 and ignored[row, pixel]:
            weight = NONE
        i = 3 * pixel - left
        out[i] = out[i + 1] = out[i + 2] = weight


@inlined
def read_row(x, y, ignored, weights, weighted, row, left, row_weights, ring, at):
    """The planes of a row from column `left` on, into a ring at `at`; x and y are 0 outside and without weight."""
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
    if weighted:
        if 0 <= row < height:
            read_weights(weights, ignored, row, left - 1, n, row_weights)
        else:
            row_weights[:] = NONE
    for i in range(at, at + WIDE, LANES):
        weight = load(row_weights, i - at + 1) if weighted else spread(ONE)
        seen_x, seen_y = select(weight == NONE, NONE, load(ring, i)), select(weight == NONE, NONE, load(ring, i + WIDE))
        a, b = seen_x - GREY, seen_y - GREY
        by_a, by_b = weight * a, weight * b
        store(seen_x, ring, i)
        store(seen_y, ring, i + WIDE)
        store(by_a, ring, i + ABOVE * WIDE)
        store(by_b, ring, i + (ABOVE + 1) * WIDE)
        store(by_a * a + by_b * b, ring, i + (ABOVE + 2) * WIDE)
        store(by_a * b, ring, i + (ABOVE + 3) * WIDE)
        if weighted:
            store(weight, ring, i + WEIGHT * WIDE)


@inlined
def compare_row(
    ring, at, means, to_mean, factors, factor_at, weighted, inside, row_inside, shares, end, slopes, to, losses
):
    """The losses of a row, and the derivatives of its SSIM; both as they count."""
    for i in range(MARGIN, end + MARGIN, LANES):
        m = to_mean + i
        inverse, outside = spread(ONE), spread(NONE)
        if weighted:
            part = row_inside * load(inside, i + 1)
            inverse = part / maximum(window(load_each(means, ALONG, m + 4 * WIDE)), FAINT)
            outside = GREY - GREY * part
        mean_x = window(load_each(means, ALONG, m)) * inverse - outside
        mean_y = window(load_each(means, ALONG, m + WIDE)) * inverse - outside
        squares = window(load_each(means, ALONG, m + 2 * WIDE)) * inverse + TWO * GREY * outside
        product = window(load_each(means, ALONG, m + 3 * WIDE)) * inverse + GREY * outside
        ssim, by_mean, by_square, by_product = similarity(mean_x, mean_y, squares, product)
        factor = load(factors, factor_at + i)
        slope = factor * inverse
        store(slope * by_mean, slopes, to + i)
        store(slope * by_square, slopes, to + WIDE + i)
        store(slope * by_product, slopes, to + 2 * WIDE + i)
        l1 = absolute(load(ring, at + i) - load(ring, at + WIDE + i))
        store(factor * (shares[0] * l1 + shares[1] * (ONE - ssim)), losses, i)


@inlined
def gradient_row(ring, at, means, to_mean, factors, factor_at, shares, end, out):
    """The gradient in a row, from the filtered derivatives of its SSIM."""
    for i in range(2 * MARGIN, end, LANES):
        m = to_mean + i
        by_mean, by_square = window(load_each(means, ALONG, m)), window(load_each(means, ALONG, m + WIDE))
        by_product = window(load_each(means, ALONG, m + 2 * WIDE))
        x, y = load(ring, at + i), load(ring, at + WIDE + i)
        sign = select(x > y, ONE, select(x < y, -ONE, NONE))
        by_ssim = by_mean + TWO * (x - GREY) * by_square + (y - GREY) * by_product
        store(load(factors, factor_at + i) * (shares[0] * sign - shares[1] * by_ssim), out, i)


@inlined
def sweep_part(x, y, ignored, weights, weighted, first, last, start, share, losses, gradient):
    """The rows [first, last) of the strip of columns from `start` on; the sum of their losses. See `sweep`.

    `weighted`, whether there are weights or hidden pixels, is a constant: each of its values is compiled apart.
    """
    height, n = x.shape
    planes, filtered = (WEIGHT + 1, 5) if weighted else (WEIGHT, 4)
    row_planes = planes * WIDE
    columns = min(STRIP, n - start)
    left, end = start - 2 * MARGIN, 2 * MARGIN + (columns + MARGIN - 1) // MARGIN * MARGIN
    ring, slopes = aligned(RING * row_planes), aligned(RING * 3 * WIDE)
    means, row_losses = aligned(GROUP * filtered * WIDE), aligned(WIDE)
    inside, windows = np.zeros(WIDE + 3, np.float32), np.zeros(WIDE + 3, np.float32)
    row_weights = np.zeros(WIDE + 3, np.float32)
    read_inside(left - 1, n, inside, windows)
    shares = np.float32(1 - share), np.float32(share)
    averaged = np.float32((1 - share) / (height * n)), np.float32(share / (height * n))
    totals = np.zeros(STRIP)
    for top in range(first - READ, last + READ, GROUP):
        newest = top - first + RING  # rows of rings are counted from the band's first on
        for k in range(GROUP):
            at = (newest + k & 15) * row_planes
            read_row(x, y, ignored, weights, weighted, top + k, left, row_weights, ring, at)
        if top < first:
            continue
        filter_down(ring, rows_below(newest - 10, row_planes), ABOVE, filtered, 0, end + 2 * MARGIN, means)
        for k in range(GROUP):
            row, to = top + k - RADIUS, (newest + k - RADIUS & 15) * 3 * WIDE
            if row < 0 or row >= height:
                slopes[to : to + 3 * WIDE] = NONE
                continue
            at = (newest + k - RADIUS & 15) * row_planes
            factors, factor_at = (ring, at + WEIGHT * WIDE) if weighted else (inside, 1)
            compare_row(
                ring, at, means, k * filtered * WIDE, factors, factor_at, weighted, windows, part_inside(row, height),
                shares, end, slopes, to, row_losses,
            )  # fmt: skip
            if first <= row < last:
                counted = row_losses[2 * MARGIN : 2 * MARGIN + columns]
                for i in range(columns):
                    totals[i] += counted[i]
                if losses.shape[0] > 0:
                    for i in range(0, columns, 3):
                        losses[row, (start + i) // 3] = (counted[i] + counted[i + 1] + counted[i + 2]) / np.float32(3)
        if gradient.shape[0] == 0 or top < first + READ:
            continue
        filter_down(slopes, rows_below(newest - READ - RADIUS, 3 * WIDE), 0, 3, MARGIN, end + MARGIN, means)
        for k in range(min(GROUP, last + READ - top)):
            row, at = top - READ + k, (newest - READ + k & 15) * row_planes
            factors, factor_at = (ring, at + WEIGHT * WIDE) if weighted else (inside, 1)
            gradient_row(ring, at, means, k * 3 * WIDE, factors, factor_at, averaged, end, row_losses)
            to_row, from_row = gradient[row, start : start + columns], row_losses[2 * MARGIN :]
            for i in range(columns):
                to_row[i] = from_row[i]
    return totals.sum()


@exact_kernel
def sweep(x, y, ignored, weights, share, sums, losses, gradient):
    """The loss of a render, of each pixel and in all, and its gradient.

    Args:
        x: the render [H, 3 W], channels interleaved.
        y: the target [H, 3 W], 8 bits.
        ignored: bool [H, W], what is hidden; [0, 0] for nothing.
        weights: [H, W] per pixel, from 0 on; [0, 0] for one everywhere.
        share: lambda.
        sums: output [bands, strips], the sum over the pixels and channels of each part.
        losses: output [H, W], averaged over channels; [0, 0] leaves it out.
        gradient: output [H, 3 W], of the average over pixels and channels; [0, 0] leaves it out.
    """
    height = len(x)
    bands, strips = sums.shape
    weighted = weights.shape[0] > 0 or ignored.shape[0] > 0
    for part in prange(bands * strips):
        band, start = part // strips, part % strips * STRIP
        first, last = band * height // bands, (band + 1) * height // bands
        if weighted:
            total = sweep_part(x, y, ignored, weights, True, first, last, start, share, losses, gradient)
        else:
            total = sweep_part(x, y, ignored, weights, False, first, last, start, share, losses, gradient)
        sums[band, start // STRIP] = total
