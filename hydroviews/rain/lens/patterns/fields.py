"""Smooth random fields over a picture: B-spline surfaces over random grids."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
KNOTS_A_SIDE = 64  # samples of a field along a side


def surface(grid: Array, x: Array, y: Array) -> Array:
    """Cubic B-spline surface over a grid, which repeats itself, at x [C] and y [R]: [R, C]."""
    return np.asarray(_spline(len(grid), y) @ grid @ _spline(len(grid), x).T)


def smooth_field(rng: np.random.Generator, extent: tuple[float, float], blobs: Sequence[int]) -> Array:
    """A field in [0, 1] over the picture, about 0.5 in the mean, [R, C].

    Args:
        rng: the generator.
        extent: width and height of the picture in sides.
        blobs: knots along a side, of the coarsest waves first; each has 0.6 of the strength of the one before.
    """
    columns, rows = (round(KNOTS_A_SIDE * side) for side in extent)
    x, y = (np.arange(columns) + 0.5) / KNOTS_A_SIDE, (np.arange(rows) + 0.5) / KNOTS_A_SIDE
    field = np.zeros((rows, columns))
    for i, knots in enumerate(blobs):
        grid = rng.uniform(-1, 1, (2 * knots, 2 * knots))
        field += 0.6**i * surface(grid, x * knots, y * knots)
    return np.clip(0.5 + 0.6 * field, 0, 1)


def _spline(knots: int, t: NDArray) -> Array:
    """Weights [T, knots] of a uniform periodic cubic B-spline."""
    start = np.floor(t).astype(int)
    f = t - start
    parts = ((1 - f) ** 3, 3 * f**3 - 6 * f**2 + 4, -3 * f**3 + 3 * f**2 + 3 * f + 1, f**3)
    weights = np.zeros((len(t), knots))
    for offset, part in enumerate(parts):
        np.add.at(weights, (np.arange(len(t)), (start + offset) % knots), part / 6)
    return weights
