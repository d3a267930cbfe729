# Numba infers the types of kernels.
# mypy: allow-untyped-defs
"""Which splats touch which tile, front to back.

    list of a tile = {splat i: u_i(p)^2 + v_i(p)^2 <= CUTOFF_i at the centre p of a pixel of it}, by rising depth

with u and v of `projection.py`. The visible Gaussians are sorted by depth once; a stable counting sort then lists them
in the tiles, so every tile's list comes out in depth order without sorting (splat, tile) pairs.
"""

import math

import numpy as np
from numba import prange

from baselines.splatting.kernels.constants import CONIC_SCALE
from baselines.splatting.kernels.jit import exact_kernel, inlined, serial_kernel
from baselines.splatting.kernels.projection import (
    CULLED,
    CUTOFF,
    HALF_HEIGHT,
    HALF_WIDTH,
    L11,
    L21,
    L22,
    X,
    Y,
)

BANDS = 8  # contiguous shares of the depth order, listed in parallel; fixed, so that the lists are too
DIGIT_BITS = 11
DIGITS = 1 << DIGIT_BITS
SLACK = 0.01  # pixels by which spans are widened: they are cut again, exactly, when blending


@serial_kernel
def depth_order(depths, keys, order, other_keys, other_order):
    """Indices of the visible Gaussians by rising depth, equal depths in index order: least-digit radix sort.

    Positive floats sort like their bit patterns. All four buffers hold at least N; the sorted indices end up in
    `other_order`. Returns how many there are.
    """
    histogram = np.zeros((3, DIGITS), np.int64)
    mask = np.uint32(DIGITS - 1)
    n = 0
    for i in range(depths.shape[0]):
        if depths[i] < CULLED:
            key = np.float32(depths[i]).view(np.uint32)
            keys[n], order[n] = key, i
            n += 1
            for digit in range(3):
                histogram[digit, (key >> np.uint32(DIGIT_BITS * digit)) & mask] += 1
    for digit in range(3):
        start = 0
        for value in range(DIGITS):
            count = histogram[digit, value]
            histogram[digit, value] = start
            start += count
        for i in range(n):
            value = (keys[i] >> np.uint32(DIGIT_BITS * digit)) & mask
            place = histogram[digit, value]
            histogram[digit, value] = place + 1
            other_keys[place], other_order[place] = keys[i], order[i]
        keys, other_keys, order, other_order = other_keys, keys, other_order, order
    return n


@inlined
def ellipse_slope(splat):
    """How far up the ellipse's rightmost point lies, per pixel to the right: cov_xy / cov_xx."""
    l11, l21, l22 = np.float64(splat[L11]), np.float64(splat[L21]), np.float64(splat[L22])
    yy = CONIC_SCALE / (l22 * l22)
    xy = -l21 / l11 * yy
    xx = CONIC_SCALE / (l11 * l11) + xy * xy / yy
    return xy / xx


@inlined
def tile_rows(splat, tile_shift, tiles_y):
    """First and last row of tiles that the ellipse may reach."""
    low = max(np.float64(splat[Y]) - splat[HALF_HEIGHT], 0.0)
    high = min(np.float64(splat[Y]) + splat[HALF_HEIGHT], 1e6)
    return np.int64(low) >> tile_shift, min(np.int64(max(high, -1.0)) >> tile_shift, tiles_y - 1)


@inlined
def tile_columns(splat, slope, tile_row, tile_shift, tiles_x):
    """First and last tile that the ellipse reaches in a row of tiles; last < first where there is none."""
    size = np.float64(1 << tile_shift)
    y = np.float64(splat[Y])
    half_height, half_width = np.float64(splat[HALF_HEIGHT]), np.float64(splat[HALF_WIDTH])
    top = max(tile_row * size + 0.5 - SLACK - y, -half_height)
    bottom = min(tile_row * size + size - 0.5 + SLACK - y, half_height)
    if not top <= bottom:
        return 1, 0
    inverse = 1.0 / np.float64(splat[L11])
    shear, l22, cutoff = np.float64(splat[L21]) * inverse, np.float64(splat[L22]), np.float64(splat[CUTOFF])
    reach_top = math.sqrt(max(cutoff - (l22 * top) ** 2, 0.0)) * inverse
    reach_bottom = math.sqrt(max(cutoff - (l22 * bottom) ** 2, 0.0)) * inverse
    right = max(reach_top - shear * top, reach_bottom - shear * bottom)
    left = min(-reach_top - shear * top, -reach_bottom - shear * bottom)
    extreme = slope * half_width  # the height of the rightmost point; the leftmost is opposite
    if top <= extreme <= bottom:
        right = half_width
    if top <= -extreme <= bottom:
        left = -half_width
    # from the first pixel centre at or after `left` to the last one at or before `right`
    x = np.float64(splat[X]) - 0.5
    start = max(x + left - SLACK, 0.0)
    end = x + right + SLACK
    width = np.float64(tiles_x << tile_shift)
    if not (end >= 0 and start < width):
        return 1, 0
    first = np.int64(start)
    if first < start:
        first += 1
    return first >> tile_shift, min(np.int64(min(end, width)) >> tile_shift, tiles_x - 1)


@exact_kernel
def count_pairs(splats, order, tile_shift, tiles_x, tiles_y, packed, rank, counts, pairs):
    """Pack the splats [N, 9 + 3 L] in depth order and count the tiles of each and the splats of each tile and band.

    Args:
        order: Gaussians by depth [n].
        packed: output [n, 9 + 3 L]. rank: output [N], -1 for culled Gaussians on entry.
        counts: output [BANDS, tiles], zero on entry. pairs: output [n + 1], tiles of each splat.
    """
    n = order.shape[0]
    for band in prange(BANDS):
        for place in range(band * n // BANDS, (band + 1) * n // BANDS):
            i = order[place]
            rank[i] = place
            splat = packed[place]
            for k in range(splats.shape[1]):
                splat[k] = splats[i, k]
            slope = ellipse_slope(splat)
            found = 0
            first_row, last_row = tile_rows(splat, tile_shift, tiles_y)
            for row in range(first_row, last_row + 1):
                first, last = tile_columns(splat, slope, row, tile_shift, tiles_x)
                for column in range(first, last + 1):
                    counts[band, row * tiles_x + column] += 1
                    found += 1
            pairs[place] = found


@serial_kernel
def sort_by_tile(pairs, counts, tile_start):
    """Turn the counts into start positions, in place; returns the number of pairs."""
    total = 0
    for place in range(pairs.shape[0]):
        count = pairs[place]
        pairs[place] = total
        total += count
    position = 0
    for tile in range(counts.shape[1]):
        tile_start[tile] = position
        for band in range(BANDS):
            count = counts[band, tile]
            counts[band, tile] = position
            position += count
    tile_start[counts.shape[1]] = position
    return position


@exact_kernel
def list_pairs(packed, tile_shift, tiles_x, tiles_y, counts, pair_start, tile_splats, pair_slot):
    """Write every tile's list of places in the depth order, and for each splat's pairs their slots in those lists."""
    n = packed.shape[0]
    for band in prange(BANDS):
        for place in range(band * n // BANDS, (band + 1) * n // BANDS):
            splat = packed[place]
            slope = ellipse_slope(splat)
            pair = pair_start[place]
            first_row, last_row = tile_rows(splat, tile_shift, tiles_y)
            for row in range(first_row, last_row + 1):
                first, last = tile_columns(splat, slope, row, tile_shift, tiles_x)
                for column in range(first, last + 1):
                    slot = counts[band, row * tiles_x + column]
                    counts[band, row * tiles_x + column] = slot + 1
                    tile_splats[slot] = place
                    pair_slot[pair] = slot
                    pair += 1
