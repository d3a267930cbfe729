"""The list of splats of each tile: what blending and its gradient work through."""

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.kernels.chunks import CHUNKS, SHARES
from baselines.splatting.kernels.tiles import binning


@dataclass(frozen=True)
class Splats:
    """What `projection.project` makes of N Gaussians: the visible ones in slots, see `chunks.py`."""

    values: NDArray[np.float32]  # [N, 9 + 3 L]
    depths: NDArray[np.float32]  # [N]
    gaussians: NDArray[np.int32]  # [N], which one a slot holds
    counts: NDArray[np.int32]  # [CHUNKS], visible ones of each chunk


@dataclass(frozen=True)
class Tiles:
    """A pair is a splat in a tile that it reaches."""

    order: NDArray[np.int32]  # visible splats [n] by rising depth, as slots
    start: NDArray[np.int32]  # [tiles + 1], where each tile's list begins
    records: NDArray[np.int32]  # [pairs, 4], the lists by rising depth: slot, pair, mask of the blocks reached
    heaviest: NDArray[np.int64]  # tiles, those with most splats first
    pair_start: NDArray[np.int32]  # [N], first pair of each slot
    pair_end: NDArray[np.int32]  # [N], and the one after its last
    pairs: int  # rows that the moments of all pairs need


def bin_splats(splats: Splats, width: int, height: int, buffers: BufferPool) -> Tiles:
    """Find the tiles of an image that splats reach, and list them by depth."""
    total = len(splats.values)
    tiles_x, tiles_y = -(-width // binning.TILE), -(-height // binning.TILE)
    room = buffers.array("room", (CHUNKS + 1,), np.int64)
    room[0] = 0
    binning.count_room(splats.values, splats.counts, tiles_x, tiles_y, room[1:])
    room_start = np.cumsum(room)
    pair_start, pair_end = (buffers.array(name, (total,), np.int32) for name in ("pair_start", "pair_end"))
    tiles = buffers.array("pair_tiles", (int(room_start[-1]),), np.int64)
    per_tile = buffers.array("per_tile", (SHARES, tiles_x * tiles_y), np.int32)
    binning.list_pairs(
        splats.values, splats.counts, room_start, tiles_x, tiles_y, pair_start, pair_end, tiles, per_tile
    )
    start = buffers.array("tile_start", (tiles_x * tiles_y + 1,), np.int32)
    start[0] = 0
    np.cumsum(per_tile.sum(axis=0), out=start[1:])
    records = buffers.array("records", (int(start[-1]), binning.RECORD), np.int32)
    workers = numba.get_num_threads()
    order = _by_depth(splats, buffers)
    binning.deal(order, pair_start, pair_end, tiles, start, workers, records)
    heaviest = np.argsort(-np.diff(start), kind="stable")
    return Tiles(order, start, records, heaviest, pair_start, pair_end, int(room_start[-1]))


def _by_depth(splats: Splats, buffers: BufferPool) -> NDArray[np.int32]:
    """The slots in use by rising depth."""
    total = len(splats.values)
    keys = [buffers.array(name, (total,), np.uint32) for name in ("keys", "other_keys")]
    orders = [buffers.array(name, (total,), np.int32) for name in ("order", "other_order")]
    passes = binning.sort_by_depth(splats.depths, splats.counts, keys[0], orders[0], keys[1], orders[1])
    return orders[passes % 2][: int(splats.counts.sum())]
