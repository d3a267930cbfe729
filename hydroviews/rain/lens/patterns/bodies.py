"""The drops of a lens told apart: bodies of water as disks, so that each can come and go alone."""

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from hydroviews.rain.lens.patterns.water import GAP, Water

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
RIBBON_STEP = 3  # of the points of a running drop's path, every third stands for its water


@dataclass(frozen=True, eq=False)
class Bodies:
    """Bodies of water on a lens: first the running drops, then the large ones, then droplets."""

    disks: Array  # [L, 3]: x, y, radius, those of one body after another
    starts: Indices  # [S + 1], where each body's disks begin
    large: int  # so many are no droplets

    def __len__(self) -> int:
        return len(self.starts) - 1

    @property
    def owners(self) -> Indices:
        """The body [L] of every disk."""
        return np.repeat(np.arange(len(self)), np.diff(self.starts))


def bodies_of(water: Water) -> Bodies:
    """The bodies of all that is on a lens, lengths as there."""
    parts = [np.column_stack(rivulet.ribbon)[::RIBBON_STEP] for rivulet in water.rivulets]
    parts += [np.array(drop.outline.disks) for drop in water.drops]
    large = len(parts)
    parts += [*water.droplets[:, None, :3], *water.beads.disks[:, None]]
    starts = np.cumsum([0, *map(len, parts)])
    return Bodies(np.concatenate([np.zeros((0, 3)), *parts]), starts, large)


def same_bodies(later: Water, first: Bodies, now: Bodies) -> Indices:
    """Which of the first bodies each of those of a later moment [S] is.

    Running drops keep their number. Any other is the first body that is nearest to its middle: drops stay where they
    are, and of those that merge the largest stays.
    """
    running = len(later.rivulets)
    found = np.arange(len(now))
    found[running:] = first.owners[nearest_disk(now.disks[now.starts[running:-1], :2], first.disks)]
    return found


@numba.njit(cache=True, nogil=True)
def nearest_disk(points: Array, disks: Array) -> Indices:
    """The disk whose rim is nearest to, or farthest around, each point [N, 2]: its index [N] among [L, 3]."""
    found = np.zeros(len(points), np.int64)
    for i in range(len(points)):
        least = np.inf
        for j in range(len(disks)):
            across, down = points[i, 0] - disks[j, 0], points[i, 1] - disks[j, 1]
            beyond = np.sqrt(across * across + down * down) - disks[j, 2]
            if beyond < least:
                least, found[i] = beyond, j
    return found


@numba.njit(cache=True, nogil=True)
def find_room(disks: Array, starts: Indices, birth: Indices) -> NDArray[np.bool_]:
    """Which of B bodies are there if each gives way to those before it that were born at another time.

    Args:
        disks: [L, 3].
        starts: [B + 1], where each body's disks begin.
        birth: [B]; what was born together has room together.
    """
    count = len(birth)
    there = np.ones(count, np.bool_)
    around = np.empty((count, 4))  # left, top, right, bottom, with the gap
    for b in range(count):
        mine = disks[starts[b] : starts[b + 1]]
        reach = GAP * mine[:, 2]
        around[b, 0], around[b, 1] = (mine[:, 0] - reach).min(), (mine[:, 1] - reach).min()
        around[b, 2], around[b, 3] = (mine[:, 0] + reach).max(), (mine[:, 1] + reach).max()
        for a in range(b):
            apart = around[a, 0] > around[b, 2] or around[b, 0] > around[a, 2]
            apart |= around[a, 1] > around[b, 3] or around[b, 1] > around[a, 3]
            if apart or not there[a] or birth[a] == birth[b]:
                continue
            if _touch(mine, disks[starts[a] : starts[a + 1]]):
                there[b] = False
                break
    return there


@numba.njit(cache=True, nogil=True)
def _touch(some: Array, others: Array) -> bool:
    for i in range(len(some)):
        for j in range(len(others)):
            across, down = some[i, 0] - others[j, 0], some[i, 1] - others[j, 1]
            near = GAP * (some[i, 2] + others[j, 2])
            if across * across + down * down < near * near:
                return True
    return False
