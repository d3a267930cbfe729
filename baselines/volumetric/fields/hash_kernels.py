# Numba infers the types of kernels.
# mypy: allow-untyped-defs
"""The hash grid's lookup and its gradient by the tables (Mueller et al. 2022, section 3).

Samples are looked up in chunks, level after level, so that a level's table stays in the cache. In the gradient every
level's table belongs to one thread, which adds samples in their order: no addition races with another, and the sums
do not depend on the number of threads.
"""

import numpy as np
from numba import prange

from baselines.splatting.kernels.jit import inlined, kernel

FEATURES = 4  # of a table's entry: one 128-bit load a corner
PRIME_Y, PRIME_Z = 2654435761, 805459861  # of Mueller et al. 2022, equation 4
CHUNK = 512  # samples


@inlined
def cell_of(coordinate, cells):
    """The cell along an axis, and how far into it a coordinate lies; what is outside [0, 1] is moved to the border."""
    kind = type(coordinate)
    scaled = min(max(coordinate, kind(0)), kind(1)) * kind(cells)
    cell = min(int(scaled), cells - 1)
    return cell, scaled - kind(cell)


@inlined
def unsigned(a, b, c, d, e, f, g, h):
    """Indices that cannot be negative, so that array accesses need no test for it."""
    return (
        np.uint64(a), np.uint64(b), np.uint64(c), np.uint64(d),
        np.uint64(e), np.uint64(f), np.uint64(g), np.uint64(h),
    )  # fmt: skip


@inlined
def corners_of(x, y, z, cells, size):
    """Entries of the eight corners of a cell: in rows where the level fits into its table, else by the hash."""
    if (cells + 1) * (cells + 1) * (cells + 1) <= size:
        row, layer = cells + 1, (cells + 1) * (cells + 1)
        at = x + row * y + layer * z
        far = at + layer
        return unsigned(at, at + 1, at + row, at + row + 1, far, far + 1, far + row, far + row + 1)
    mask = size - 1
    y0, y1, z0, z1 = y * PRIME_Y, (y + 1) * PRIME_Y, z * PRIME_Z, (z + 1) * PRIME_Z
    near0, near1, far0, far1 = y0 ^ z0, y1 ^ z0, y0 ^ z1, y1 ^ z1
    return unsigned(
        (x ^ near0) & mask, ((x + 1) ^ near0) & mask, (x ^ near1) & mask, ((x + 1) ^ near1) & mask,
        (x ^ far0) & mask, ((x + 1) ^ far0) & mask, (x ^ far1) & mask, ((x + 1) ^ far1) & mask,
    )  # fmt: skip


@inlined
def shares_of(u, v, w):
    """Trilinear weights of the same corners."""
    one = type(u)(1)
    a, b, c, d = (one - v) * (one - w), v * (one - w), (one - v) * w, v * w
    left = one - u
    return left * a, u * a, left * b, u * b, left * c, u * c, left * d, u * d


@kernel
def look_up(points, tables, resolutions, features):
    """Trilinearly interpolated entries.

    Args:
        points: [N, 3] in [0, 1].
        tables: [L, T, 4], T a power of two.
        resolutions: cells along an axis [L] int64.
        features: [N, L, 4], filled.
    """
    levels, size = tables.shape[0], tables.shape[1]
    count = points.shape[0]
    for chunk in prange((count + CHUNK - 1) // CHUNK):
        for level in range(levels):
            table, cells = tables[level], resolutions[level]
            for i in range(chunk * CHUNK, min((chunk + 1) * CHUNK, count)):
                x, u = cell_of(points[i, 0], cells)
                y, v = cell_of(points[i, 1], cells)
                z, w = cell_of(points[i, 2], cells)
                c0, c1, c2, c3, c4, c5, c6, c7 = corners_of(x, y, z, cells, size)
                s0, s1, s2, s3, s4, s5, s6, s7 = shares_of(u, v, w)
                for f in range(FEATURES):
                    near = s0 * table[c0, f] + s1 * table[c1, f] + s2 * table[c2, f] + s3 * table[c3, f]
                    far = s4 * table[c4, f] + s5 * table[c5, f] + s6 * table[c6, f] + s7 * table[c7, f]
                    features[i, level, f] = near + far


@kernel
def look_up_gradient(points, gradient, resolutions, tables_gradient):
    """Adds to `tables_gradient` [L, T, 4] the transpose of `look_up`, applied to `gradient` [N, L, 4]."""
    levels, size = tables_gradient.shape[0], tables_gradient.shape[1]
    for turn in prange(levels):
        level = turn // 2 if turn % 2 == 0 else levels - 1 - turn // 2  # cheap coarse levels beside fine ones
        table, cells = tables_gradient[level], resolutions[level]
        for i in range(points.shape[0]):
            x, u = cell_of(points[i, 0], cells)
            y, v = cell_of(points[i, 1], cells)
            z, w = cell_of(points[i, 2], cells)
            corners, shares = corners_of(x, y, z, cells, size), shares_of(u, v, w)
            for k in range(8):
                for f in range(FEATURES):
                    table[corners[k], f] += shares[k] * gradient[i, level, f]
