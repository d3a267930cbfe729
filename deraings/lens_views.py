"""Which photographs one lens took, held one way: what is on it lies in the same place of these alone."""

import math
from collections.abc import Sequence

ALIKE = 0.1  # difference of the logarithms of two ratios of sides: 4:3 and 3:2 differ by 0.12, lenses set right by less


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
