"""Points that a cloud has several times: of merged clouds, or of one that was exported once a view.

A method would start with Gaussians of no size there, and put new ones into the same places.
"""

import numpy as np
from numpy.typing import NDArray

from hydroviews.scene.scenes import Points

FEW = 0.1  # share of doubles up to which a cloud stays as it is: structure from motion leaves up to a twentieth
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
    kept = _first(cells + 0.5, kept)  # of two that a cell's border divides
    many = len(kept) < (1 - FEW) * len(points)
    return Points(points.positions[kept], points.colours[kept]) if many else points


def _first(cells: NDArray[np.float64], kept: NDArray[np.int64]) -> NDArray[np.int64]:
    """Those of some rows [N, 3] that come first in their cell of a unit's size."""
    whole = np.floor(np.clip(cells[kept], -1e18, 1e18)).astype(np.int64)
    order = np.lexsort(whole.T[::-1])
    same = (np.diff(whole[order], axis=0) == 0).all(axis=1)
    starts = np.flatnonzero(np.r_[True, ~same])
    return kept[np.sort(np.minimum.reduceat(order, starts))]
