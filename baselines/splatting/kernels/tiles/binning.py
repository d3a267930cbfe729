# Numba infers the types of kernels.
# mypy: allow-untyped-defs
"""Which splats touch which tile and which blocks of it, front to back.

    list of a tile = {splat i: u_i(p)^2 + v_i(p)^2 <= CUTOFF_i at the centre p of a pixel of it}, by rising depth

with u and v of `projection.py`. A tile is 16x16 pixels, a block 4x4. A band is four rows of pixels: between its first
and its last row an ellipse reaches from one block to another one, which gives the blocks of all tiles at once.

Pairs of a splat and a tile are numbered in the order of the splats, so that gradients are gathered in sequence, and
dealt out to the tiles in the order of depths, so that every list comes out sorted.
"""

import numpy as np
from numba import prange

from baselines.splatting.kernels.chunks import CHUNKS, SHARES
from baselines.splatting.kernels.jit import inlined, kernel, serial_kernel
from baselines.splatting.kernels.splats.projection import CUTOFF, HALF_HEIGHT, HALF_WIDTH, L11, L21, L22, X, Y
from baselines.splatting.kernels.vector.memory import prefetch, spread, store
from baselines.splatting.kernels.vector.vectors import (
    LANES,
    lane_numbers,
    maximum,
    minimum,
    select,
    square_root,
    whole,
)

TILE, BLOCK = 16, 4  # pixels
BANDS = TILE // BLOCK  # of a tile
SLOT, PAIR, BLOCKS, RECORD = 0, 1, 2, 4  # columns of a list's records, and how long one is
MASK_BITS = 16  # of a tile's blocks: bit 4 row + column
SLACK = 0.01  # pixels by which ellipses are widened; blending tests every pixel again
ROUNDING = 2e-6  # the same as a share of their distances, for those many screens wide
SPAN = 28  # blocks of a band that are found at a time: seven tiles
WIDER = 1.0005  # factor of the cutoff, which is an ellipse's squared size
AHEAD = 16  # splats that are brought into the cache before their turn
DIGIT_BITS = 12
DIGITS = 1 << DIGIT_BITS


@inlined
def tile_box(flat, splat, tiles_x, tiles_y):
    """First and last column and row of tiles in the box around an ellipse; last < first where there is none."""
    x, y = flat[splat + X] - np.float32(0.5), flat[splat + Y] - np.float32(0.5)
    reach_x = flat[splat + HALF_WIDTH] * np.float32(1 + ROUNDING) + np.float32(SLACK)
    reach_y = flat[splat + HALF_HEIGHT] * np.float32(1 + ROUNDING) + np.float32(SLACK)
    end_x, end_y = np.float32(tiles_x * TILE - 1), np.float32(tiles_y * TILE - 1)
    left, right = max(x - reach_x, np.float32(0)), min(x + reach_x, end_x)
    top, bottom = max(y - reach_y, np.float32(0)), min(y + reach_y, end_y)
    if not (left <= right and top <= bottom):
        return 0, -1, 0, -1
    return np.int64(left) // TILE, np.int64(right) // TILE, np.int64(top) // TILE, np.int64(bottom) // TILE


@kernel
def count_room(splats, counts, tiles_x, tiles_y, room):
    """How many pairs the splats [N, 9 + 3 L] of each chunk have at most, into room [CHUNKS]."""
    n, stride = splats.shape
    flat = splats.reshape(-1)
    for share in prange(SHARES):
        for chunk in range(share, CHUNKS, SHARES):
            first = chunk * n // CHUNKS
            total = 0
            for slot in range(first, first + counts[chunk]):
                left, right, top, bottom = tile_box(flat, slot * stride, tiles_x, tiles_y)
                total += (right - left + 1) * (bottom - top + 1)
            room[chunk] = total


@inlined
def find_blocks(flat, splat, first_band, end_band, first_block, width, blocks):
    """Which of the SPAN blocks from `first_block` on an ellipse reaches in each band, as bits.

    Bands are filled up to a multiple of LANES.
    """
    x, y = flat[splat + X] - np.float32(0.5), flat[splat + Y] - np.float32(0.5)
    half_width, half_height = flat[splat + HALF_WIDTH], flat[splat + HALF_HEIGHT]
    inverse = np.float32(1) / flat[splat + L11]
    shear, l22 = flat[splat + L21] * inverse, flat[splat + L22]
    cutoff = flat[splat + CUTOFF] * np.float32(WIDER) + np.float32(1e-6)
    # the height of the rightmost point; the leftmost is opposite
    extreme = -shear * half_height * (half_height / half_width)
    slack = np.float32(SLACK) + np.float32(ROUNDING) * (abs(x) + half_width)
    for band in range(first_band, end_band, LANES):
        start = (lane_numbers() + np.float32(band)) * np.float32(BLOCK) - y
        top, bottom = maximum(start, -half_height), minimum(start + np.float32(BLOCK - 1), half_height)
        at_top, at_bottom = l22 * top, l22 * bottom
        reach_top = square_root(maximum(cutoff - at_top * at_top, np.float32(0))) * inverse
        reach_bottom = square_root(maximum(cutoff - at_bottom * at_bottom, np.float32(0))) * inverse
        middle_top, middle_bottom = -shear * top, -shear * bottom
        right = maximum(middle_top + reach_top, middle_bottom + reach_bottom)
        left = minimum(middle_top - reach_top, middle_bottom - reach_bottom)
        right = select((top <= extreme) & (bottom >= extreme), half_width, right)
        left = select((top <= -extreme) & (bottom >= -extreme), -half_width, left)
        # pixel centres are whole numbers here: block k has those from 4 k to 4 k + 3
        low = minimum(maximum(left + (x - slack + np.float32(0.999)), np.float32(0)), width) * np.float32(1 / BLOCK)
        high = minimum(maximum(right + (x + slack), np.float32(-BLOCK)), width) * np.float32(1 / BLOCK)
        start_bit = minimum(maximum(whole(low) - first_block, np.int32(0)), np.int32(SPAN))
        end_bit = minimum(maximum(whole(high + np.float32(1)) - first_block, np.int32(0)), np.int32(SPAN))
        reached = (top <= bottom + slack) & (end_bit > start_bit)
        ones = spread(np.int32(1))
        store(select(reached, (ones << end_bit) - (ones << start_bit), np.int32(0)), blocks, band)


@kernel
def list_pairs(splats, counts, room_start, tiles_x, tiles_y, pair_start, pair_end, tiles, per_tile):
    """The tiles that splats reach, and which blocks of them.

    Args:
        splats, counts: from `project`.
        room_start: [CHUNKS], the first pair of each chunk.
        tiles_x, tiles_y: tiles across and down.
        pair_start, pair_end: output [N], the pairs of each slot.
        tiles: output [room], tile << 16 | mask of blocks of each pair.
        per_tile: output [SHARES, tiles], pairs of each tile by share.
    """
    n, stride = splats.shape
    flat = splats.reshape(-1)
    width = np.float32(tiles_x * TILE - 1)
    for share in prange(SHARES):
        blocks = np.empty(tiles_y * BANDS + LANES, np.int32)
        per_tile[share] = 0
        for chunk in range(share, CHUNKS, SHARES):
            first = chunk * n // CHUNKS
            pair = np.int64(room_start[chunk])
            for slot in range(first, first + counts[chunk]):
                pair_start[slot] = pair
                left, right, top, bottom = tile_box(flat, slot * stride, tiles_x, tiles_y)
                for start in range(left, right + 1, SPAN // BANDS):
                    find_blocks(
                        flat, slot * stride, top * BANDS, (bottom + 1) * BANDS, np.int32(start * BANDS), width, blocks
                    )
                    for row in range(top, bottom + 1):
                        at = row * BANDS
                        for column in range(min(SPAN // BANDS, right + 1 - start)):
                            mask, shift = np.int64(0), BANDS * column
                            for band in range(BANDS):
                                mask |= (np.int64(blocks[at + band]) >> shift & (1 << BANDS) - 1) << BANDS * band
                            if mask:
                                tile = row * tiles_x + start + column
                                tiles[pair] = tile << MASK_BITS | mask
                                per_tile[share, tile] += 1
                                pair += 1
                pair_end[slot] = pair


@serial_kernel
def sort_by_depth(depths, counts, keys, order, other_keys, other_order):
    """The slots [n] of the visible Gaussians by rising depth, those of equal depth in their own order.

    Least-digit radix sort: positive floats sort like their bit patterns, of which the least is taken off. All four
    buffers hold N; the sorted slots are in `order` if the result is even, else in `other_order`.
    """
    total, n = depths.shape[0], 0
    bits = depths.view(np.uint32)
    least, most = np.uint32(0xFFFFFFFF), np.uint32(0)
    for chunk in range(CHUNKS):
        first = chunk * total // CHUNKS
        for slot in range(first, first + counts[chunk]):
            keys[n], order[n] = bits[slot], slot
            least, most = min(least, bits[slot]), max(most, bits[slot])
            n += 1
    passes = 0
    count = np.empty(DIGITS, np.int64)
    while n and (np.int64(most) - np.int64(least)) >> (DIGIT_BITS * passes):
        shift = np.uint32(DIGIT_BITS * passes)
        count[:] = 0
        for place in range(n):
            count[np.uint32(keys[place] - least) >> shift & np.uint32(DIGITS - 1)] += 1
        start = 0
        for digit in range(DIGITS):
            start, count[digit] = start + count[digit], start
        for place in range(n):
            key = np.uint32(keys[place] - least) >> shift & np.uint32(DIGITS - 1)
            to = count[key]
            count[key] = to + 1
            other_keys[to], other_order[to] = keys[place], order[place]
        keys, other_keys, order, other_order = other_keys, keys, other_order, order
        passes += 1
    return passes


@kernel
def deal(order, pair_start, pair_end, tiles, tile_start, workers, records):
    """Fill every tile's list with records [pairs, 4]: slot, pair, mask of blocks.

    Args:
        order: slots by depth [n].
        pair_start, pair_end, tiles: from `list_pairs`.
        tile_start: [tiles + 1], where each list begins.
        workers: threads, each of which fills its own range of tiles; changes nothing in the result.
        records: output.
    """
    count = tile_start.shape[0] - 1
    pairs = np.int64(tile_start[count])
    for worker in prange(workers):
        first = np.searchsorted(tile_start, worker * pairs // workers) if worker else 0
        end = np.searchsorted(tile_start, (worker + 1) * pairs // workers) if worker + 1 < workers else count
        places = tile_start[first : end + 1].copy()
        for k in range(order.shape[0]):
            if k + 2 * AHEAD < order.shape[0]:
                prefetch(pair_start, np.int64(order[k + 2 * AHEAD]))
                prefetch(pair_end, np.int64(order[k + 2 * AHEAD]))
                prefetch(tiles, np.int64(pair_start[order[k + AHEAD]]))
            slot = order[k]
            for pair in range(pair_start[slot], pair_end[slot]):
                tile = np.int64(tiles[pair]) >> MASK_BITS
                if first <= tile < end:
                    place = np.int64(places[tile - first])
                    places[tile - first] = place + 1
                    records[place, SLOT] = slot
                    records[place, PAIR] = pair
                    records[place, BLOCKS] = tiles[pair] & ((1 << MASK_BITS) - 1)
