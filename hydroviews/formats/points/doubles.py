"""Points that a cloud has several times: of merged clouds, or of one that was exported once a view.

A method would start with Gaussians of no size there, and put new ones into the same places.
"""

import numpy as np
from numpy.typing import NDArray

from hydroviews.scene.scenes import Points

FEW = 0.1  # share of doubles up to which a cloud stays as it is: structure from motion leaves up to a twentieth
# Odd numbers of 64 bits that make one number of a cell: two of a million cells share it once in 40 million clouds.
MIXED = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], np.uint64)
SAME = 1e-5  # of the points' median distance from their middle, within which two points are one


def without_doubles(points: Points) -> Points:
    """The first of all points that are in the same place, in their order; all of them where few are doubles."""
    if len(points) < 2:
        return points
    middle = np.median(points.positions, axis=0)
    size = SAME * float(np.median(np.linalg.norm(points.positions - middle, axis=1)))
    if size == 0:
        return points
    cells = (points.positions - middle) / size
    kept = _first(cells, np.arange(len(points)))
    if len(kept) >= (1 - FEW) * len(points):
        return points
    kept = _first(cells + 0.5, kept)  # of two that a cell's border divides
    return Points(points.positions[kept], points.colours[kept])


def _first(cells: NDArray[np.float64], kept: NDArray[np.int64]) -> NDArray[np.int64]:
    """Those of some rows [N, 3], ascending, that come first in their cell of a unit's size."""
    whole = np.floor(np.clip(cells[kept], -1e18, 1e18)).astype(np.int64).astype(np.uint64)
    mixed = np.bitwise_xor.reduce(whole * MIXED, axis=1)
    mixed ^= mixed >> np.uint64(31)
    return kept[np.sort(np.unique(mixed, return_index=True)[1])]
