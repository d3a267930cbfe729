"""Coefficients of real spherical harmonics up to degree 3: how many there are, and the constants of their basis.

The files of Gaussians need these alone, and not the compiler that the kernels need.
"""

import math

import numpy as np
from numpy.typing import NDArray

MAX_DEGREE = 3

C0 = 0.5 / math.sqrt(math.pi)
C1 = 0.5 * math.sqrt(3 / math.pi)
C2_XY = 0.5 * math.sqrt(15 / math.pi)
C2_ZZ = 0.25 * math.sqrt(5 / math.pi)
C2_XX = 0.25 * math.sqrt(15 / math.pi)
C3_3 = 0.25 * math.sqrt(35 / (2 * math.pi))
C3_2 = 0.5 * math.sqrt(105 / math.pi)
C3_1 = 0.25 * math.sqrt(21 / (2 * math.pi))
C3_0 = 0.25 * math.sqrt(7 / math.pi)
C3_XX = 0.25 * math.sqrt(105 / math.pi)


def coefficients(degree: int) -> int:
    """Coefficients a colour channel has up to `degree`: 1, 4, 9 or 16."""
    return (degree + 1) ** 2


def degree_of(n_coefficients: int) -> int:
    """The degree that has this many coefficients.

    Raises:
        ValueError: no degree from 0 to 3 has.
    """
    for degree in range(MAX_DEGREE + 1):
        if coefficients(degree) == n_coefficients:
            return degree
    raise ValueError(f"{n_coefficients} spherical-harmonic coefficients, expected 1, 4, 9 or 16")


def from_colour(colour: NDArray) -> NDArray[np.float32]:
    """Degree-0 coefficients of a colour in [0, 1]."""
    return ((np.asarray(colour) - 0.5) / C0).astype(np.float32)
