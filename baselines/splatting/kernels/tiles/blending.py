# Numba infers the types of kernels.
# mypy: allow-untyped-defs
"""Splats to pixels, front to back (Kerbl et al. 2023, equation 3).

    colour = sum_i colour_i alpha_i T_i + background T,   T_i = prod_{j < i} (1 - alpha_j),   T = prod_j (1 - alpha_j)

over the splats of a pixel's tile by rising depth, without those of alpha below 1/255, until T would fall below 1e-4.

One tile of 16x16 pixels at a time, in a state that stays in the first-level cache; of a tile, those blocks of 4x4
pixels that a splat reaches. Several sets of colours of the same splats are blended at once.
"""

import numpy as np
from numba import prange

from baselines.splatting.kernels.buffer_pool import aligned_empty
from baselines.splatting.kernels.constants import LOG2_MIN_ALPHA, MAX_ALPHA, MIN_TRANSMITTANCE
from baselines.splatting.kernels.jit import inlined, kernel
from baselines.splatting.kernels.splats.projection import COLOURS, L11, L21, L22, LOG2_OPACITY, X, Y
from baselines.splatting.kernels.tiles.binning import BLOCK, BLOCKS, RECORD, SLOT, TILE
from baselines.splatting.kernels.vector.memory import (
    add_colours,
    aligned,
    channels_of,
    get,
    load,
    prefetch,
    spread,
    spread_colours,
    store,
)
from baselines.splatting.kernels.vector.vectors import LANES, absolute, bits, exp2, lowest_bit, maximum, minimum, select

PIXELS = BLOCK * BLOCK  # of a block, the length of a plane
ACROSS = TILE // BLOCK
TILE_BLOCKS = ACROSS * ACROSS
TILE_PIXELS = TILE * TILE
# Planes of a block's state; sums of red, green and blue of every set of colours are the last. A finished pixel's
# transmittance is stored negated; pixels outside the image start finished.
TRANSMITTANCE, LAST, SUMS = 0, PIXELS, 2 * PIXELS
CHECK_EVERY = 32  # splats between two checks of which blocks are finished
AHEAD = 12  # splats that are brought into the cache before their turn
HALF = np.float32(0.5)
BRIGHTEST, DIMMEST = np.float32(MAX_ALPHA), np.float32(MIN_TRANSMITTANCE)
FAINTEST = np.float32(LOG2_MIN_ALPHA)

# Of a tile: x and y of the pixels of its first block, then of its blocks' first pixels
PIXEL_X, PIXEL_Y, BLOCK_X, BLOCK_Y = (PIXELS * part for part in range(4))
_STEPS = np.arange(BLOCK, dtype=np.float32)
GRID = aligned_empty(4 * PIXELS)
GRID[:] = np.concatenate([np.tile(_STEPS, 4), np.repeat(_STEPS, 4), np.tile(4 * _STEPS, 4), np.repeat(4 * _STEPS, 4)])
# Where a state begins with what `place` says of a splat: u and v at the pixels of the first block, and how much more
# they are at the other blocks.
U, V, MORE_U, MORE_V, STATE = (PIXELS * part for part in range(5))


@inlined
def place(flat, splat, x0, y0, grid, state):
    """Write u and v of one splat over the pixels of a tile, at (x0, y0), into the state."""
    left, top = x0 + HALF - get(flat, splat + X), y0 + HALF - get(flat, splat + Y)
    l11, l21, l22 = spread(get(flat, splat + L11)), spread(get(flat, splat + L21)), spread(get(flat, splat + L22))
    first_u, first_v = l11 * left + l21 * top, l22 * top
    for part in range(0, PIXELS, LANES):
        y, block_y = load(grid, PIXEL_Y + part), load(grid, BLOCK_Y + part)
        store(l11 * load(grid, PIXEL_X + part) + (l21 * y + first_u), state, U + part)
        store(l22 * y + first_v, state, V + part)
        store(l11 * load(grid, BLOCK_X + part) + l21 * block_y, state, MORE_U + part)
        store(l22 * block_y, state, MORE_V + part)


@inlined
def placed(state, block, part, log2_opacity):
    """What `place` wrote, u and v at LANES pixels of a block, and log2 of what the splat covers of them."""
    u = load(state, U + part) + spread(get(state, MORE_U + block))
    v = load(state, V + part) + spread(get(state, MORE_V + block))
    return u, v, log2_opacity - v * v - u * u


@inlined
def clear(state, planes, columns, rows, grid):
    """Start a tile: nothing in front of the pixels inside the image, the others finished. Returns the blocks inside."""
    state[:] = np.float32(0)
    blocks = 0
    for block in range(TILE_BLOCKS):
        any_inside = 0
        for part in range(0, PIXELS, LANES):
            x = load(grid, PIXEL_X + part) + get(grid, BLOCK_X + block)
            y = load(grid, PIXEL_Y + part) + get(grid, BLOCK_Y + block)
            inside = (x < columns) & (y < rows)
            any_inside |= bits(inside)
            at = STATE + block * planes + TRANSMITTANCE + part
            store(select(inside, np.float32(1), np.float32(-1)), state, at)
        if any_inside:
            blocks |= 1 << block
    return blocks


@inlined
def live_blocks(state, planes, blocks):
    """Those of the blocks that have a pixel which is not finished."""
    for block in range(TILE_BLOCKS):
        unfinished = 0
        for part in range(0, PIXELS, LANES):
            transmittance = load(state, STATE + block * planes + TRANSMITTANCE + part)
            unfinished |= bits(transmittance > np.float32(0))
        if not unfinished:
            blocks &= ~(1 << block)
    return blocks


@inlined
def blend_splat(flat, splat, x0, y0, number, mask, state, lasts, planes, sets, grid):
    """Blend one splat into the blocks of a tile; returns the mask of those that took it."""
    place(flat, splat, x0, y0, grid, state)
    log2_opacity, number = spread(get(flat, splat + LOG2_OPACITY)), spread(number)
    colours = spread_colours(sets, flat, splat + COLOURS)
    taken_by = 0
    while mask:
        block = lowest_bit(mask)
        mask &= mask - 1
        for part in range(0, PIXELS, LANES):
            at = STATE + block * planes + part
            _, _, exponent = placed(state, block, part, log2_opacity)
            transmittance = load(state, at + TRANSMITTANCE)
            touched = (exponent >= FAINTEST) & (transmittance > np.float32(0))
            weight = select(touched, minimum(exp2(exponent), BRIGHTEST) * transmittance, np.float32(0))
            unfinished = transmittance - weight >= DIMMEST
            taken = touched & unfinished
            weight = select(taken, weight, np.float32(0))
            add_colours(colours, weight, state, at + SUMS, PIXELS)
            last = select(taken, number, np.int32(0))
            store(maximum(load(lasts, at + LAST), last), lasts, at + LAST)
            left_over = transmittance - weight
            store(select(touched & ~unfinished, -left_over, left_over), state, at + TRANSMITTANCE)
            if bits(taken):
                taken_by |= 1 << block
    return taken_by


@inlined
def write_tile(state, lasts, planes, channels, tile, x0, y0, width, height, background, pixels, transmittance, last):
    """Add the background and copy a finished tile to the images."""
    for block in range(TILE_BLOCKS):
        for part in range(0, PIXELS, LANES):
            at, to = STATE + block * planes + part, tile * TILE_PIXELS + block * PIXELS + part
            store(absolute(load(state, at + TRANSMITTANCE)), transmittance, to)
            store(load(lasts, at + LAST), last, to)
        x, y = x0 + BLOCK * (block % ACROSS), y0 + BLOCK * (block // ACROSS)
        columns, rows = min(BLOCK, width - x), min(BLOCK, height - y)
        for row in range(rows):
            at = STATE + block * planes + BLOCK * row
            for channel in range(channels):
                to = ((channel // 3 * height + y + row) * width + x) * 3 + channel % 3
                behind = background[channel % 3]
                for column in range(columns):
                    seen = state[at + SUMS + PIXELS * channel + column]
                    pixels[to + 3 * column] = seen + abs(state[at + TRANSMITTANCE + column]) * behind


@kernel
def blend(splats, tile_start, records, tile_order, grid, background, workers, sets, transmittance, last, images):
    """Fill the images [L, H, W, 3] of all sets of colours and what their gradients need.

    Args:
        splats: [N, 9 + 3 L] in slots.
        tile_start, records: every tile's list, from `deal`; of every record, the mask of blocks becomes that of the
            blocks which took something of the splat.
        tile_order: tiles, heaviest first.
        grid: GRID.
        background: [3].
        workers: threads to share the tiles between; changes nothing in the result.
        sets: a tuple of L numbers, whatever they are: each L has machine code of its own.
        transmittance: output [tiles, 256], block by block: what is left for the background.
        last: output [tiles, 256], number of the last splat that each pixel took, from 1 in its tile's list.
    """
    height, width, stride = images.shape[1], images.shape[2], splats.shape[1]
    tiles_x = (width + TILE - 1) // TILE
    flat, pixels, flat_records = splats.reshape(-1), images.reshape(-1), records.reshape(-1)
    for worker in prange(workers):
        channels = channels_of(sets)
        planes = SUMS + PIXELS * channels
        state = aligned(STATE + TILE_BLOCKS * planes)
        lasts = state.view(np.int32)
        for turn in range(worker, tile_order.shape[0], workers):
            tile = tile_order[turn]
            x0, y0 = (tile % tiles_x) * TILE, (tile // tiles_x) * TILE
            live = clear(state, planes, np.float32(width - x0), np.float32(height - y0), grid)
            start, end = np.int64(tile_start[tile]), np.int64(tile_start[tile + 1])
            for position in range(start, end):
                if (position - start) % CHECK_EVERY == CHECK_EVERY - 1:
                    live = live_blocks(state, planes, live)
                if position + AHEAD < end:
                    ahead = np.int64(flat_records[RECORD * (position + AHEAD) + SLOT]) * stride
                    prefetch(flat, ahead)
                    prefetch(flat, ahead + stride - 1)
                record = RECORD * position
                mask = np.int64(flat_records[record + BLOCKS]) & live
                if mask:
                    mask = blend_splat(
                        flat, np.int64(flat_records[record + SLOT]) * stride, np.float32(x0), np.float32(y0),
                        np.int32(position - start + 1), mask, state, lasts, planes, sets, grid,
                    )  # fmt: skip
                flat_records[record + BLOCKS] = mask
            write_tile(
                state, lasts, planes, channels, tile, x0, y0, width, height, background, pixels, transmittance, last
            )


def by_pixel(planes, width, height):
    """What `blend` wrote block by block, [tiles, 256], as an image [H, W]."""
    tiles_x, tiles_y = -(-width // TILE), -(-height // TILE)
    blocks = planes.reshape(tiles_y, tiles_x, ACROSS, ACROSS, BLOCK, BLOCK)
    return blocks.transpose(0, 2, 4, 1, 3, 5).reshape(tiles_y * TILE, tiles_x * TILE)[:height, :width].copy()
