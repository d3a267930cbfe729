"""A view's splats in depth order, and the list of each tile: what blending and its gradient work through."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from baselines.splatting.kernels import binning
from baselines.splatting.kernels.buffer_pool import BufferPool

LARGE_IMAGE = 300_000  # pixels from which tiles of 32x32 are faster than 16x16


@dataclass(frozen=True)
class Tiles:
    """Of n visible ones of N Gaussians; a pair is a splat in a tile that it reaches."""

    order: NDArray[np.int32]  # visible Gaussians [n], nearest first
    rank: NDArray[np.int32]  # [N], place in that order; negative where culled
    packed: NDArray[np.float32]  # [n, 9 + 3 L], splats in that order
    shift: int  # tiles are 2^shift pixels wide and high
    start: NDArray[np.int32]  # [tiles + 1], where each tile's list begins
    splats: NDArray[np.int32]  # [pairs], the lists: places in the depth order
    heaviest: NDArray[np.int64]  # tiles, those with most splats first
    pair_start: NDArray[np.int32]  # [n + 1], first pair of each place
    pair_slot: NDArray[np.int32]  # [pairs], where the lists hold each place's pairs


def bin_splats(
    splats: NDArray[np.float32], depths: NDArray[np.float32], width: int, height: int, buffers: BufferPool
) -> Tiles:
    """Sort splats [N, 9 + 3 L] by depths [N], infinite where culled, and find the tiles of an image they reach."""
    total = len(splats)
    sort_keys = [buffers.array(name, (total,), np.uint32) for name in ("keys", "keys2")]
    sort_values = [buffers.array(name, (total,), np.int32) for name in ("order2", "order")]
    visible = binning.depth_order(depths, sort_keys[0], sort_values[0], sort_keys[1], sort_values[1])
    order = sort_values[1][:visible]

    shift = 5 if width * height >= LARGE_IMAGE else 4
    tiles_x, tiles_y = (width + (1 << shift) - 1) >> shift, (height + (1 << shift) - 1) >> shift
    packed = buffers.array("packed", (visible, splats.shape[1]))
    rank = buffers.array("rank", (total,), np.int32)
    rank.fill(-1)
    counts = buffers.array("counts", (binning.BANDS, tiles_x * tiles_y), np.int32)
    counts.fill(0)
    pair_start = buffers.array("pair_start", (visible + 1,), np.int32)
    pair_start[-1] = 0
    tile_start = buffers.array("tile_start", (tiles_x * tiles_y + 1,), np.int32)
    binning.count_pairs(splats, order, shift, tiles_x, tiles_y, packed, rank, counts, pair_start)
    pairs = binning.sort_by_tile(pair_start, counts, tile_start)
    tile_splats = buffers.array("tile_splats", (pairs,), np.int32)
    pair_slot = buffers.array("pair_slot", (pairs,), np.int32)
    binning.list_pairs(packed, shift, tiles_x, tiles_y, counts, pair_start, tile_splats, pair_slot)
    heaviest = np.argsort(-np.diff(tile_start), kind="stable")
    return Tiles(order, rank, packed, shift, tile_start, tile_splats, heaviest, pair_start, pair_slot)
