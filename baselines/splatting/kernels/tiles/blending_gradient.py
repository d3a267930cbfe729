# Numba infers the types of kernels.
# mypy: allow-untyped-defs
"""The gradient of blending, back to front.

    dloss/dcolour_i = alpha_i T_i g,      dloss/dalpha_i = T_i (colour_i . g) - S_i / (1 - alpha_i)

for g = dloss/dpixel. Going backwards, T_i = T_{i+1} / (1 - alpha_i), and one number a pixel is summed up,
S_i = sum_{j>i} (colour_j . g) alpha_j T_j with the background as the last term. Sets of colours share all else: these
sums run over the colours of all.

What projection's gradient needs of a splat is w = alpha dloss/dalpha and its moments in u and v, summed over pixels.
Each pair of a splat and a tile has a row of its own for them, so threads never add to the same number.
"""

import numpy as np
from numba import prange

from baselines.splatting.kernels.jit import inlined, kernel
from baselines.splatting.kernels.splats.projection import COLOURS, L21, L22, LOG2_OPACITY
from baselines.splatting.kernels.splats.shape_gradient import TO_COLOURS
from baselines.splatting.kernels.tiles.binning import BLOCK, BLOCKS, PAIR, RECORD, SLOT, TILE
from baselines.splatting.kernels.tiles.blending import (
    ACROSS,
    AHEAD,
    BRIGHTEST,
    FAINTEST,
    PIXELS,
    STATE,
    TILE_BLOCKS,
    TILE_PIXELS,
    place,
    placed,
)
from baselines.splatting.kernels.vector.memory import (
    add_scaled,
    aligned,
    channels_of,
    dot_colours,
    get,
    load,
    prefetch,
    spread,
    spread_colours,
    store,
    store_sums,
    zeros,
)
from baselines.splatting.kernels.vector.vectors import LANES, absolute, exp2, lowest_bit, minimum, reciprocal, select

# Planes of a block's state: what is left of the light, S, the last splat taken, and g of every set of colours.
TRANSMITTANCE, SUFFIX, LAST, GRADS = 0, PIXELS, 2 * PIXELS, 3 * PIXELS
# Of a row of moments: w, w u, w v, w u^2, w u v, w v^2, |w u|, |(L21 / L22) w u + w v|, then dloss/dcolour of each set.
MOMENTS_STEP = 16  # rows are filled up to a multiple of this
ONE, NOTHING = np.float32(1), np.float32(0)


def moments_of(sets: int) -> int:
    """The length of a row of moments for so many sets of colours."""
    return -(-(TO_COLOURS + 3 * sets) // MOMENTS_STEP) * MOMENTS_STEP


@inlined
def load_tile(state, lasts, planes, channels, tile, x0, y0, width, height, background, pixels, transmittance, last):
    """Start a tile where the forward pass ended."""
    state[:] = NOTHING
    for block in range(TILE_BLOCKS):
        x, y = x0 + BLOCK * (block % ACROSS), y0 + BLOCK * (block // ACROSS)
        columns, rows = min(BLOCK, width - x), min(BLOCK, height - y)
        for row in range(rows):
            for channel in range(channels):
                at = ((channel // 3 * height + y + row) * width + x) * 3 + channel % 3
                to = STATE + block * planes + GRADS + PIXELS * channel + BLOCK * row
                for column in range(columns):
                    state[to + column] = pixels[at + 3 * column]
        for part in range(0, PIXELS, LANES):
            at, pixel = STATE + block * planes + part, tile * TILE_PIXELS + block * PIXELS + part
            behind = spread(NOTHING)
            for channel in range(channels):
                behind = load(state, at + GRADS + PIXELS * channel) * background[channel % 3] + behind
            left = load(transmittance, pixel)
            store(left, state, at + TRANSMITTANCE)
            store(behind * left, state, at + SUFFIX)
            store(load(last, pixel), lasts, at + LAST)


@inlined
def take_off(flat, splat, x0, y0, number, mask, state, lasts, planes, grid, sets, moments, row):
    """Take one splat off the blocks of a tile that took it, and write its moments."""
    place(flat, splat, x0, y0, grid, state)
    log2_opacity, number = spread(get(flat, splat + LOG2_OPACITY)), spread(number)
    ratio = spread(get(flat, splat + L21) / get(flat, splat + L22))
    colours = spread_colours(sets, flat, splat + COLOURS)
    m = m_u = m_v = m_uu = m_uv = m_vv = abs_u = abs_v = spread(NOTHING)
    to_colours = zeros(sets)
    while mask:
        block = lowest_bit(mask)
        mask &= mask - 1
        for part in range(0, PIXELS, LANES):
            at = STATE + block * planes + part
            u, v, exponent = placed(state, block, part, log2_opacity)
            taken = (exponent >= FAINTEST) & (load(lasts, at + LAST) >= number)
            raw = exp2(exponent)
            alpha = select(taken, minimum(raw, BRIGHTEST), NOTHING)
            inverse = reciprocal(ONE - alpha)
            transmittance = load(state, at + TRANSMITTANCE) * inverse
            store(transmittance, state, at + TRANSMITTANCE)
            visible = alpha * transmittance
            toward = dot_colours(colours, state, at + GRADS, PIXELS)
            suffix = load(state, at + SUFFIX)
            by_alpha = transmittance * toward - suffix * inverse
            store(toward * visible + suffix, state, at + SUFFIX)
            # an alpha held at its maximum does not move with the exponent
            w = select(taken & (raw <= BRIGHTEST), raw * by_alpha, NOTHING)
            w_u, w_v = w * u, w * v
            m, m_u, m_v = m + w, m_u + w_u, m_v + w_v
            m_uu, m_uv, m_vv = w_u * u + m_uu, w_u * v + m_uv, w_v * v + m_vv
            abs_u, abs_v = abs_u + absolute(w_u), abs_v + absolute(ratio * w_u + w_v)
            to_colours = add_scaled(to_colours, visible, state, at + GRADS, PIXELS)
    sums = (m, m_u, m_v, m_uu, m_uv, m_vv, abs_u, abs_v) + to_colours  # noqa: RUF005  # what Numba can compile
    store_sums(sums, moments, row)


@kernel
def blend_gradient(
    splats, tile_start, records, tile_order, grid, background, workers, sets, transmittance, last,
    grad_images, moments,
):  # fmt: skip
    """Fill the moments [pairs, moments_of(L)] of every pair; the other arguments are those of `blend`."""
    height, width, stride = grad_images.shape[1], grad_images.shape[2], splats.shape[1]
    tiles_x = (width + TILE - 1) // TILE
    flat, pixels, flat_records = splats.reshape(-1), grad_images.reshape(-1), records.reshape(-1)
    flat_moments, row_size = moments.reshape(-1), moments.shape[1]
    for worker in prange(workers):
        channels = channels_of(sets)
        planes = GRADS + PIXELS * channels
        state = aligned(STATE + TILE_BLOCKS * planes)
        lasts = state.view(np.int32)
        for turn in range(worker, tile_order.shape[0], workers):
            tile = tile_order[turn]
            start, end = np.int64(tile_start[tile]), np.int64(tile_start[tile + 1])
            if start == end:
                continue
            x0, y0 = (tile % tiles_x) * TILE, (tile // tiles_x) * TILE
            load_tile(
                state, lasts, planes, channels, tile, x0, y0, width, height, background, pixels, transmittance, last
            )
            for position in range(end - 1, start - 1, -1):
                if position - AHEAD >= start:
                    ahead = np.int64(flat_records[RECORD * (position - AHEAD) + SLOT]) * stride
                    prefetch(flat, ahead)
                    prefetch(flat, ahead + stride - 1)
                record = RECORD * position
                take_off(
                    flat, np.int64(flat_records[record + SLOT]) * stride, np.float32(x0), np.float32(y0),
                    np.int32(position - start + 1), np.int64(flat_records[record + BLOCKS]), state, lasts, planes,
                    grid, sets, flat_moments, np.int64(flat_records[record + PAIR]) * row_size,
                )  # fmt: skip
