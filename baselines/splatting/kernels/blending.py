# Numba infers the types of kernels.
# mypy: allow-untyped-defs
"""Splats to pixels, front to back (Kerbl et al. 2023, equation 3).

    colour = sum_i colour_i alpha_i T_i + background T,   T_i = prod_{j < i} (1 - alpha_j),   T = prod_j (1 - alpha_j)

over the splats of a pixel's tile by rising depth, without those of alpha below 1/255, until T would fall below 1e-4.

One tile at a time in a scratch buffer that stays in the first-level cache, 8 pixels of a row at a time. The buffer is
laid out in blocks of 8 pixels, with the planes of a block one after the other, so that one pointer walks a row whatever
the tile size is. Several sets of colours of the same splats are blended at once.
"""

import math

import numpy as np
from llvmlite import ir
from numba import prange
from numba.core import types
from numba.extending import intrinsic

from baselines.splatting.kernels.constants import LOG2_MIN_ALPHA, MAX_ALPHA, MIN_TRANSMITTANCE
from baselines.splatting.kernels.jit import inlined, kernel
from baselines.splatting.kernels.projection import COLOURS, CUTOFF, HALF_HEIGHT, L11, L21, L22, LOG2_OPACITY, X, Y
from baselines.splatting.kernels.vectors import BLOCK_BYTES, INT64, LANES, Lanes

# Planes of a block; sums of red, green and blue of every set of colours are the last. A finished pixel's transmittance
# is stored negated; pixels outside the image start finished.
TRANSMITTANCE, LAST, SUMS = range(3)
CHECK_EVERY = 16  # splats between two checks of which rows are finished


@intrinsic
def blend_row(typingctx, table, address, blocks, l11, u, power, log2_opacity, number, colours, sets):
    """Blend one splat into `blocks` blocks of a row from `address` on.

    u: L11 dx + L21 dy at the first pixel; power: log2 opacity - v^2; number: the splat's place in the tile's list,
    from 1, kept for the last splat each pixel took; colours: address of its colours, three for each set of them.
    """
    signature = types.void(*[types.int64] * 3, *[types.float32] * 5, types.int64, sets)
    channels = 3 * sets.count

    def generate(context, builder, _, arguments):
        lanes = Lanes(builder, arguments[0])
        address, blocks = arguments[1:3]
        l11, u, power, log2_opacity, number = (lanes.splat(a) for a in arguments[3:8])
        colours = lanes.scalars(arguments[8], channels)

        def turn(address, u):
            transmittance = lanes.load(address, TRANSMITTANCE)
            # rounding may leave the exponent above the opacity's
            exponent = lanes.minimum(lanes.fma(lanes.negate(u), u, power), log2_opacity)
            touched = lanes.at_least(exponent, lanes.constant(LOG2_MIN_ALPHA))
            alpha = lanes.minimum(lanes.exp2(exponent), lanes.constant(MAX_ALPHA))
            weight = lanes.multiply(alpha, transmittance)
            alive = lanes.at_least(lanes.subtract(transmittance, weight), lanes.constant(MIN_TRANSMITTANCE))
            taken = lanes.both(touched, alive)
            finished = lanes.both(touched, builder.not_(alive))
            weight = lanes.select(taken, weight, lanes.constant(0))
            lanes.store(lanes.negative_where(finished, lanes.subtract(transmittance, weight)), address, TRANSMITTANCE)
            for plane, colour in enumerate(colours, SUMS):
                lanes.store(lanes.fma(weight, colour, lanes.load(address, plane)), address, plane)
            last = lanes.select(taken, number, lanes.constant(0))
            lanes.store(lanes.maximum(lanes.load(address, LAST), last), address, LAST)

        starts = lanes.fma(l11, lanes.lane_numbers(), u)
        step = lanes.multiply(l11, lanes.constant(LANES))
        lanes.loop(blocks, [(address, ir.Constant(INT64, (SUMS + channels) * BLOCK_BYTES)), (starts, step)], turn)
        return context.get_dummy_value()

    return signature, generate


@inlined
def row_blocks(l11, l21, l22, cutoff, log2_opacity, left, dy, tile_size):
    """The blocks of a tile's row that a splat reaches.

    Args:
        left: x of the tile's first pixel centre minus the splat's. dy: y of the row minus the splat's.

    Returns:
        First block, number of blocks (0 for none), u at the first block's first pixel, log2 opacity - v^2.
    """
    v = l22 * dy
    rest = cutoff - v * v
    power = log2_opacity - v * v
    u = l21 * dy + l11 * left
    if not rest >= np.float32(0):
        return 0, 0, u, power
    inverse = np.float32(1) / l11
    middle, reach = -u * inverse, math.sqrt(rest) * inverse
    if not (middle + reach >= np.float32(0) and middle - reach <= np.float32(tile_size - 1)):
        return 0, 0, u, power
    first = np.int64(max(middle - reach, np.float32(0))) // LANES
    last = np.int64(min(middle + reach, np.float32(tile_size - 1))) // LANES
    return first, last - first + 1, np.float32(u + l11 * np.float32(first * LANES)), power


@inlined
def live_rows(scratch, planes, tile_size, first, end):
    """The range of rows that still have an unfinished pixel; empty (first >= end) when none has."""
    row_blocks = tile_size // LANES
    low, high = tile_size, 0
    for row in range(first, end):
        alive = False
        for block in range(row * row_blocks, (row + 1) * row_blocks):
            for lane in range(LANES):
                alive |= scratch[(block * planes + TRANSMITTANCE) * LANES + lane] > 0
        if alive:
            low, high = min(low, row), row + 1
    return low, high


@inlined
def clear(scratch, planes, tile_size, columns, rows):
    """Start a tile: nothing in front of the pixels inside the image, the others finished."""
    row_blocks = tile_size // LANES
    scratch[:] = np.float32(0)
    for row in range(tile_size):
        for column in range(tile_size):
            block = row * row_blocks + column // LANES
            inside = row < rows and column < columns
            scratch[(block * planes + TRANSMITTANCE) * LANES + column % LANES] = np.float32(1 if inside else -1)


@inlined
def write_tile(scratch, planes, tile_size, x0, y0, columns, rows, background, images, transmittance, last):
    """Add the background and copy a finished tile to the images."""
    row_blocks = tile_size // LANES
    for row in range(rows):
        for column in range(columns):
            pixel = (row * row_blocks + column // LANES) * planes * LANES + column % LANES
            remaining = abs(scratch[pixel + TRANSMITTANCE * LANES])
            for image in range(images.shape[0]):
                for channel in range(3):
                    seen = scratch[pixel + (SUMS + 3 * image + channel) * LANES] + remaining * background[channel]
                    images[image, y0 + row, x0 + column, channel] = seen
            transmittance[y0 + row, x0 + column] = remaining
            last[y0 + row, x0 + column] = scratch[pixel + LAST * LANES]


@kernel
def blend(
    packed, tile_start, tile_splats, tile_order, tile_shift, background, workers, table, sets,
    transmittance, last, taken, images,
):  # fmt: skip
    """Fill the images [L, H, W, 3] of all sets of colours and what their gradients need.

    Args:
        packed: splats in depth order [n, 9 + 3 L].
        tile_start, tile_splats: every tile's list, from `list_pairs`.
        tile_order: tiles, heaviest first.
        background: [3].
        workers: threads to share the tiles between; changes nothing in the result.
        table: address of `vectors.CONSTANTS`.
        sets: a tuple of L numbers, whatever they are: each L has machine code of its own.
        transmittance: output [H, W], what is left for the background.
        last: output [H, W], number of the last splat that each pixel took, from 1 in its tile's list.
        taken: output [tiles], how far each tile's list was worked through.
    """
    height, width = images.shape[1], images.shape[2]
    tile_size = 1 << tile_shift
    tiles_x = (width + tile_size - 1) >> tile_shift
    planes = SUMS + packed.shape[1] - COLOURS
    block_bytes = planes * BLOCK_BYTES
    row_bytes = tile_size // LANES * block_bytes
    colours, splat_bytes = np.int64(packed.ctypes.data) + COLOURS * 4, packed.shape[1] * 4
    for worker in prange(workers):
        scratch = np.empty(tile_size * tile_size * planes, np.float32)
        address = np.int64(scratch.ctypes.data)
        for turn in range(worker, tile_order.shape[0], workers):
            tile = tile_order[turn]
            x0, y0 = (tile % tiles_x) << tile_shift, (tile // tiles_x) << tile_shift
            columns, rows = min(tile_size, width - x0), min(tile_size, height - y0)
            clear(scratch, planes, tile_size, columns, rows)
            first_live, end_live = 0, rows
            start, end = tile_start[tile], tile_start[tile + 1]
            position = start
            while position < end:
                if (position - start) % CHECK_EVERY == CHECK_EVERY - 1:
                    first_live, end_live = live_rows(scratch, planes, tile_size, first_live, end_live)
                    if first_live >= end_live:
                        break
                splat = packed[tile_splats[position]]
                left = np.float32(x0) + np.float32(0.5) - splat[X]
                centre = splat[Y] - np.float32(y0) - np.float32(0.5)
                first_row = np.int64(max(centre - splat[HALF_HEIGHT], np.float32(first_live)))
                last_row = np.int64(min(centre + splat[HALF_HEIGHT], np.float32(end_live - 1)))
                number = np.float32(position - start + 1)
                for row in range(first_row, last_row + 1):
                    block, blocks, u, power = row_blocks(
                        splat[L11], splat[L21], splat[L22], splat[CUTOFF], splat[LOG2_OPACITY],
                        left, np.float32(row) - centre, tile_size,
                    )  # fmt: skip
                    if blocks > 0:
                        blend_row(  # type: ignore[call-arg]  # Numba fills the typing context in
                            table, address + row * row_bytes + block * block_bytes, blocks, splat[L11], u, power,
                            splat[LOG2_OPACITY], number, colours + tile_splats[position] * splat_bytes, sets,
                        )  # fmt: skip
                position += 1
            taken[tile] = position - start
            write_tile(scratch, planes, tile_size, x0, y0, columns, rows, background, images, transmittance, last)
