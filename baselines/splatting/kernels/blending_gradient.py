# Numba infers the types of kernels.
# mypy: allow-untyped-defs
"""The gradient of blending, back to front.

    dloss/dcolour_i = alpha_i T_i g,      dloss/dalpha_i = T_i (colour_i . g) - S_i / (1 - alpha_i)

for g = dloss/dpixel. Going backwards, T_i = T_{i+1} / (1 - alpha_i), and one number a pixel is summed up,
S_i = sum_{j>i} (colour_j . g) alpha_j T_j with the background as the last term. Sets of colours share all else: these
sums run over the colours of all. Each (tile, splat) pair gets one row of moments of its own, so threads never
add to the same number.
"""

import numpy as np
from llvmlite import ir
from numba import prange
from numba.core import types
from numba.extending import intrinsic

from baselines.splatting.kernels.blending import row_blocks
from baselines.splatting.kernels.constants import LOG2_MIN_ALPHA, MAX_ALPHA
from baselines.splatting.kernels.jit import inlined, kernel
from baselines.splatting.kernels.projection import COLOURS, CUTOFF, HALF_HEIGHT, L11, L21, L22, LOG2_OPACITY, X, Y
from baselines.splatting.kernels.projection_gradient import TO_COLOURS
from baselines.splatting.kernels.vectors import BLOCK_BYTES, INT64, LANES, Lanes

# Planes of a block of pixels, and of a block of column sums; red, green and blue of every set of colours come last.
TRANSMITTANCE, SUFFIX, LAST, GRADS = range(4)
W, W_DY, W_DY2, ABS_X, ABS_Y, TO_COLOUR = range(6)


@intrinsic
def blend_row_gradient(
    typingctx, table, address, sums, blocks, l11, u, power, log2_opacity, number, dy, l21, rise, colours, sets
):
    """Take one splat off `blocks` blocks of a row and add its derivatives to the column sums; rise is L22 v."""
    signature = types.void(*[types.int64] * 4, *[types.float32] * 8, types.int64, sets)
    channels = 3 * sets.count

    def generate(context, builder, _, arguments):
        lanes = Lanes(builder, arguments[0])
        address, sums, blocks = arguments[1:4]
        l11, u, power, log2_opacity, number, dy, l21, rise = map(lanes.splat, arguments[4:12])
        colours = lanes.scalars(arguments[12], channels)
        zero, one, max_alpha = lanes.constant(0), lanes.constant(1), lanes.constant(MAX_ALPHA)

        def accumulate(sums, plane, a, b):
            lanes.store(lanes.fma(a, b, lanes.load(sums, plane)), sums, plane)

        def turn(address, sums, u):
            exponent = lanes.minimum(lanes.fma(lanes.negate(u), u, power), log2_opacity)
            touched = lanes.at_least(exponent, lanes.constant(LOG2_MIN_ALPHA))
            taken = lanes.both(touched, lanes.at_least(lanes.load(address, LAST), number))
            raw = lanes.exp2(exponent)
            alpha = lanes.select(taken, lanes.minimum(raw, max_alpha), zero)
            inverse = lanes.divide(one, lanes.subtract(one, alpha))
            transmittance = lanes.multiply(lanes.load(address, TRANSMITTANCE), inverse)
            lanes.store(transmittance, address, TRANSMITTANCE)
            visible = lanes.multiply(alpha, transmittance)
            grads = [lanes.load(address, GRADS + channel) for channel in range(channels)]
            toward = lanes.multiply(colours[-1], grads[-1])
            for colour, grad in list(zip(colours, grads, strict=True))[-2::-1]:
                toward = lanes.fma(colour, grad, toward)
            suffix = lanes.load(address, SUFFIX)
            g_alpha = lanes.fma(lanes.negate(suffix), inverse, lanes.multiply(transmittance, toward))
            lanes.store(lanes.fma(toward, visible, suffix), address, SUFFIX)
            # an alpha held at its maximum does not move with the exponent
            moves = lanes.both(taken, lanes.at_least(max_alpha, raw))
            w = lanes.select(moves, lanes.negate(lanes.multiply(raw, g_alpha)), zero)
            lanes.store(lanes.add(lanes.load(sums, W), w), sums, W)
            w_dy = lanes.multiply(w, dy)
            lanes.store(lanes.add(lanes.load(sums, W_DY), w_dy), sums, W_DY)
            accumulate(sums, W_DY2, w_dy, dy)
            for plane, grad in enumerate(grads, TO_COLOUR):
                accumulate(sums, plane, visible, grad)
            by_x, by_y = lanes.multiply(w, u), lanes.multiply(w, lanes.fma(l21, u, rise))
            lanes.store(lanes.add(lanes.load(sums, ABS_X), lanes.absolute(by_x)), sums, ABS_X)
            lanes.store(lanes.add(lanes.load(sums, ABS_Y), lanes.absolute(by_y)), sums, ABS_Y)

        starts = lanes.fma(l11, lanes.lane_numbers(), u)
        step = lanes.multiply(l11, lanes.constant(LANES))
        stride = ir.Constant(INT64, (GRADS + channels) * BLOCK_BYTES)
        sums_stride = ir.Constant(INT64, (TO_COLOUR + channels) * BLOCK_BYTES)
        lanes.loop(blocks, [(address, stride), (sums, sums_stride), (starts, step)], turn)
        return context.get_dummy_value()

    return signature, generate


@inlined
def load_tile(scratch, planes, tile_size, x0, y0, columns, rows, background, grad_images, transmittance, last):
    """Start a tile where the forward pass ended."""
    blocks_in_row = tile_size // LANES
    scratch[:] = np.float32(0)
    for row in range(rows):
        for column in range(columns):
            pixel = (row * blocks_in_row + column // LANES) * planes * LANES + column % LANES
            remaining, behind = transmittance[y0 + row, x0 + column], np.float32(0)
            for image in range(grad_images.shape[0]):
                for channel in range(3):
                    grad = grad_images[image, y0 + row, x0 + column, channel]
                    scratch[pixel + (GRADS + 3 * image + channel) * LANES] = grad
                    behind += background[channel] * grad
            scratch[pixel + TRANSMITTANCE * LANES] = remaining
            scratch[pixel + SUFFIX * LANES] = behind * remaining
            scratch[pixel + LAST * LANES] = last[y0 + row, x0 + column]


@inlined
def fold_columns(sums, planes, tile_size, left, moments):
    """Column sums to the moments of a pair."""
    w = w_dx = w_dy = w_dx2 = w_dxdy = w_dy2 = abs_x = abs_y = np.float32(0)
    for column in range(tile_size):
        at = column // LANES * (planes * LANES) + column % LANES
        dx = np.float32(column) + left
        here, here_dy = sums[at + W * LANES], sums[at + W_DY * LANES]
        w += here
        w_dx += here * dx
        w_dy += here_dy
        w_dx2 += here * dx * dx
        w_dxdy += here_dy * dx
        w_dy2 += sums[at + W_DY2 * LANES]
        abs_x += sums[at + ABS_X * LANES]
        abs_y += sums[at + ABS_Y * LANES]
    moments[0], moments[1], moments[2] = w, w_dx, w_dy
    moments[3], moments[4], moments[5] = w_dx2, w_dxdy, w_dy2
    moments[6], moments[7] = abs_x, abs_y
    for plane in range(TO_COLOUR, planes):
        total = np.float32(0)
        for column in range(tile_size):
            total += sums[(column // LANES * planes + plane) * LANES + column % LANES]
        moments[TO_COLOURS + plane - TO_COLOUR] = total


@kernel
def blend_gradient(
    packed, tile_start, tile_splats, tile_order, tile_shift, background, workers, table, sets,
    transmittance, last, taken, grad_images, pair_moments,
):  # fmt: skip
    """Fill the moments [pairs, 8 + 3 L] of every (tile, splat) pair; the other arguments are those of `blend`."""
    height, width = grad_images.shape[1], grad_images.shape[2]
    tile_size = 1 << tile_shift
    tiles_x = (width + tile_size - 1) >> tile_shift
    channels = packed.shape[1] - COLOURS
    planes, sum_planes = GRADS + channels, TO_COLOUR + channels
    block_bytes, sum_bytes = planes * BLOCK_BYTES, sum_planes * BLOCK_BYTES
    colours, splat_bytes = np.int64(packed.ctypes.data) + COLOURS * 4, packed.shape[1] * 4
    row_bytes = tile_size // LANES * block_bytes
    for worker in prange(workers):
        scratch = np.empty(tile_size * tile_size * planes, np.float32)
        sums = np.empty(tile_size * sum_planes, np.float32)
        address, sums_address = np.int64(scratch.ctypes.data), np.int64(sums.ctypes.data)
        for turn in range(worker, tile_order.shape[0], workers):
            tile = tile_order[turn]
            x0, y0 = (tile % tiles_x) << tile_shift, (tile // tiles_x) << tile_shift
            columns, rows = min(tile_size, width - x0), min(tile_size, height - y0)
            load_tile(scratch, planes, tile_size, x0, y0, columns, rows, background, grad_images, transmittance, last)
            start = tile_start[tile]
            for position in range(start + taken[tile], tile_start[tile + 1]):
                for k in range(pair_moments.shape[1]):
                    pair_moments[position, k] = np.float32(0)
            for position in range(start + taken[tile] - 1, start - 1, -1):
                splat = packed[tile_splats[position]]
                left = np.float32(x0) + np.float32(0.5) - splat[X]
                centre = splat[Y] - np.float32(y0) - np.float32(0.5)
                first_row = np.int64(max(centre - splat[HALF_HEIGHT], np.float32(0)))
                last_row = np.int64(min(centre + splat[HALF_HEIGHT], np.float32(rows - 1)))
                number = np.float32(position - start + 1)
                sums[:] = np.float32(0)
                for row in range(first_row, last_row + 1):
                    dy = np.float32(np.float32(row) - centre)
                    block, blocks, u, power = row_blocks(
                        splat[L11], splat[L21], splat[L22], splat[CUTOFF], splat[LOG2_OPACITY], left, dy, tile_size
                    )
                    if blocks > 0:
                        blend_row_gradient(  # type: ignore[call-arg]  # as for blend_row
                            table, address + row * row_bytes + block * block_bytes, sums_address + block * sum_bytes,
                            blocks, splat[L11], u, power, splat[LOG2_OPACITY], number, dy,
                            splat[L21], splat[L22] * splat[L22] * dy,
                            colours + tile_splats[position] * splat_bytes, sets,
                        )  # fmt: skip
                fold_columns(sums, sum_planes, tile_size, left, pair_moments[position])
