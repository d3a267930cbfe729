"""Which photographs one lens took, held one way, and what planes of theirs have in common at a place of the lens.

What is on the lens lies in the same place of these alone.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from deraings.image_planes import Plane, resized

ALIKE = 0.1  # difference of the logarithms of two ratios of sides: 4:3 and 3:2 differ by 0.12, lenses set right by less
AROUND = 8.0  # standard deviation, in views before and after, of what counts for a view: drops move slowly
MIN_WEIGHT = 0.01  # of a view; those further away count for nothing


def one_shape(first: tuple[int, ...], second: tuple[int, ...]) -> bool:
    """Whether pictures of two sizes (height, width) have one shape, as far as one lens goes."""
    return abs(math.log(first[1] * second[0] / (first[0] * second[1]))) < ALIKE


def by_shape(sizes: Sequence[tuple[int, ...]]) -> list[list[int]]:
    """The numbers of pictures of (height, width) each, shape by shape, the commonest first."""
    shapes: list[list[int]] = []
    for number, size in enumerate(sizes):
        own = next((shape for shape in shapes if one_shape(sizes[shape[0]], size)), None)
        if own is None:
            shapes.append(own := [])
        own.append(number)
    return sorted(shapes, key=len, reverse=True)


def mean_around(view: int, planes: Mapping[int, NDArray], size: tuple[int, ...], deviation: float) -> Plane | None:
    """The mean of planes of views, those taken at about the same time counting most; None where none counts.

    Planes of another shape are of another lens, and do not count.

    Args:
        view: whose neighbours count.
        planes: by the number of their view, brought to `size`.
        size: height and width.
        deviation: standard deviation of the weights, from 0, in views before and after; with 0 none counts.
    """
    mean, total = np.zeros(size, np.float32), 0.0
    for other, plane in sorted(planes.items()):  # sums in one order, whatever that of the lessons
        if not one_shape(plane.shape, size):
            continue
        near = (other - view) / deviation if deviation else math.inf
        weight = math.exp(-0.5 * near**2)
        if weight > MIN_WEIGHT:
            mean += np.float32(weight) * resized(plane, size)
            total += weight
    return mean / np.float32(total) if total else None
