"""How much of a scene's colour depends on the direction it is seen from: the spherical-harmonic degree it needs.

Before anything is trained, scene points are looked up in the training views that see them. What such a colour does
from view to view is mostly not view dependence: texture slides under the pixels, edges and rain pass by. It differs
from point to point, though, while gloss is shared by a surface. So a patch of neighbouring points is cut in two: to one
half's deviations from each point's own colour spherical harmonics of every degree are fitted, and each view of the
other half is predicted by the fit that leaves this view out. In one closed form: with the hat matrix H of ridge least
squares, the prediction for view v without v is y_v - (y_v - (H y)_v) / (1 - H_vv) (Allen 1974; Golub et al. 1979).
"""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from baselines.splatting.point_colours import PointColours, evenly, look_up_points
from baselines.splatting.spherical_harmonics import MAX_DEGREE, basis, coefficients
from hydroviews.scenes import Scene

LONG_SIDE = 320  # of the pictures that colours are looked up in: view dependence needs no detail
OUTLIER = 0.15  # a deviation from the point's median colour larger than this is another surface or a drop
PATCHES, PATCH = 2000, 16  # how many, of how many points
FEWEST_VIEWS = 5  # that must see a point, and a patch
FEWEST_PATCHES = 100
RIDGES = (0.03, 0.3)  # in views, the penalty on all coefficients but the first: the better one for each degree
KEPT = 0.9  # of a patch's views, the best predicted ones
MARGIN = 0.02  # by which a higher degree must predict better
CHUNK = 128  # patches at a time


@dataclass(frozen=True)
class SHChoice:
    """The chosen degree and what it was chosen by, for the record."""

    degree: int
    errors: tuple[float, ...]  # held-out error of degrees 0, 1, ..., root mean square, encoded colours; empty: unknown
    patches: int
    views: int
    reason: str


def choose_sh_degree(scene: Scene, most: int = MAX_DEGREE) -> SHChoice:
    """The lowest degree whose held-out error is within 2 % of the lowest, from the training views alone.

    Args:
        scene: with images at any size; what masks hide is not looked at.
        most: the highest degree to choose, 0 to 3; it is taken where there is too little to tell by.

    Raises:
        ValueError: no such degree.
        InputError: an image, mask or depth map that cannot be read.
    """
    if not 0 <= most <= MAX_DEGREE:
        raise ValueError(f"spherical-harmonic degree {most}, expected 0 to {MAX_DEGREE}")
    samples = sample_views(scene)
    squares = held_out_squares(samples, most)
    patches, views = squares.shape[2], len(samples.centres)
    if patches < FEWEST_PATCHES:
        reason = (
            f"{patches} patches of points in {FEWEST_VIEWS} views or more, too few to tell: at least {FEWEST_PATCHES}"
        )
        return SHChoice(most, (), patches, views, reason)
    errors = np.sqrt(squares.mean(axis=2)).min(axis=0)
    degree = int(np.flatnonzero(errors <= (1 + MARGIN) * errors.min())[0])
    reason = f"the lowest within {MARGIN:.0%} of the least held-out error"
    return SHChoice(degree, tuple(float(e) for e in errors), patches, views, reason)


def sample_views(scene: Scene) -> PointColours:
    """The scene's points in its training views, brought to a small size, with a progress bar."""
    small = scene.resized(LONG_SIDE)
    views = small.train_views
    return look_up_points(small, lambda number: views[number].image(), "view dependence")


def held_out_squares(samples: PointColours, most: int) -> NDArray[np.float64]:
    """Mean square held-out error [ridges, most + 1, patches] of every degree, for patches that enough views show."""
    seen, deviations = _deviations(samples)
    often = seen.sum(axis=1) >= FEWEST_VIEWS
    seen, deviations, positions = seen[often], deviations[often], samples.positions[often]
    if len(positions) < PATCH:
        return np.zeros((len(RIDGES), most + 1, 0))
    neighbours = cKDTree(positions).query(positions[evenly(len(positions), PATCHES)], PATCH)[1]
    squares = []
    for start in range(0, len(neighbours), CHUNK):
        some = slice(start, start + CHUNK)
        directions = positions[neighbours[some, 0], None] - samples.centres
        fitted, count = _average(deviations, seen, neighbours[some, ::2])
        target, other = _average(deviations, seen, neighbours[some, 1::2])
        weights = np.where((count >= PATCH // 8) & (other >= PATCH // 8), count / (PATCH // 2), 0)
        enough = (weights > 0).sum(axis=1) >= FEWEST_VIEWS
        values = _basis(most, directions[enough])
        colours, weights, target = fitted[enough], weights[enough], target[enough]
        errors = [((target - p) ** 2).mean(axis=2) for p in _left_out(colours, weights, values, most)]
        squares.append(np.array([_trimmed(e, weights > 0) for e in errors]).reshape(len(RIDGES), most + 1, -1))
    return np.concatenate(squares, axis=2)


def _deviations(samples: PointColours) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """Which samples are no outliers [P, V], and how they deviate from their point's median colour [P, V, 3]."""
    colours = np.where(samples.seen[..., None], samples.colours, np.nan)
    blind = ~samples.seen.any(axis=1)
    colours[blind] = 0
    deviations = colours - np.nanmedian(colours, axis=1, keepdims=True)
    seen = samples.seen & (np.abs(deviations).max(axis=2, initial=0) <= OUTLIER)
    return seen, np.where(seen[..., None], deviations, 0).astype(np.float64)


def _average(
    deviations: NDArray[np.float64], seen: NDArray[np.bool_], points: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Mean deviation of each row of points [C, K] in each view [C, V, 3], and how many of them it shows [C, V]."""
    count = seen[points].sum(axis=1)
    return deviations[points].sum(axis=1) / np.maximum(count, 1)[..., None], count


def _basis(degree: int, directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Spherical harmonics [C, V, K] of directions [C, V, 3] of any length."""
    unit = directions / np.maximum(np.linalg.norm(directions, axis=2, keepdims=True), 1e-12)
    values = np.empty((coefficients(degree), *unit.shape[:2]))
    on_arrays: Any = getattr(basis, "py_func", basis)  # the kernel's own formulas, uncompiled
    on_arrays(degree, *np.moveaxis(unit, 2, 0), values)
    return np.moveaxis(values, 0, 2)


def _left_out(
    colours: NDArray[np.float64], weights: NDArray[np.float64], values: NDArray[np.float64], most: int
) -> Iterator[NDArray[np.float64]]:
    """For each ridge and each degree what the other views predict for each view [C, V, 3]."""
    for ridge, degree in itertools.product(RIDGES, range(most + 1)):
        b = values[..., : coefficients(degree)]
        penalty = ridge * np.eye(b.shape[2])
        penalty[0, 0] = 1e-9
        weighted = np.swapaxes(b * weights[..., None], 1, 2)
        solution = np.linalg.solve(weighted @ b + penalty, weighted)
        left = 1 - (b * np.swapaxes(solution, 1, 2)).sum(axis=2, keepdims=True)
        yield colours - (colours - b @ (solution @ colours)) / np.maximum(left, 1e-6)


def _trimmed(squares: NDArray[np.float64], used: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Mean [C] of the smallest nine tenths of each row [C, V]."""
    ordered = np.sort(np.where(used, squares, np.inf), axis=1)
    kept = np.ceil(KEPT * used.sum(axis=1)).astype(int)
    return np.where(np.arange(ordered.shape[1]) < kept[:, None], ordered, 0).sum(axis=1) / np.maximum(kept, 1)
