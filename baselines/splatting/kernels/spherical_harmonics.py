# Numba infers the types of kernels.
# mypy: allow-untyped-defs
"""Real spherical harmonics up to degree 3, in the order and with the signs that 3DGS files use.

    colour = 0.5 + sum_k coefficient_k basis_k(direction)

with k = l (l + 1) + m for degree l and order m.
"""

import math

import numpy as np
from numpy.typing import NDArray

from baselines.splatting.kernels.jit import inlined

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


@inlined
def basis(degree, x, y, z, out):
    """Values at the unit vector (x, y, z) into out [>= (degree + 1)^2]."""
    out[0] = C0
    if degree > 0:
        out[1] = -C1 * y
        out[2] = C1 * z
        out[3] = -C1 * x
    if degree > 1:
        xx, yy, zz = x * x, y * y, z * z
        out[4] = C2_XY * x * y
        out[5] = -C2_XY * y * z
        out[6] = C2_ZZ * (2 * zz - xx - yy)
        out[7] = -C2_XY * x * z
        out[8] = C2_XX * (xx - yy)
        if degree > 2:
            out[9] = -C3_3 * y * (3 * xx - yy)
            out[10] = C3_2 * x * y * z
            out[11] = -C3_1 * y * (4 * zz - xx - yy)
            out[12] = C3_0 * z * (2 * zz - 3 * xx - 3 * yy)
            out[13] = -C3_1 * x * (4 * zz - xx - yy)
            out[14] = C3_XX * z * (xx - yy)
            out[15] = -C3_3 * x * (xx - 3 * yy)


@inlined
def basis_gradient(degree, x, y, z, out):
    """Derivatives of the polynomials above by x, y and z into out [>= (degree + 1)^2, 3]; row 0 is left alone."""
    if degree > 0:
        out[1, 0], out[1, 1], out[1, 2] = 0.0, -C1, 0.0
        out[2, 0], out[2, 1], out[2, 2] = 0.0, 0.0, C1
        out[3, 0], out[3, 1], out[3, 2] = -C1, 0.0, 0.0
    if degree > 1:
        xx, yy, zz = x * x, y * y, z * z
        out[4, 0], out[4, 1], out[4, 2] = C2_XY * y, C2_XY * x, 0.0
        out[5, 0], out[5, 1], out[5, 2] = 0.0, -C2_XY * z, -C2_XY * y
        out[6, 0], out[6, 1], out[6, 2] = -2 * C2_ZZ * x, -2 * C2_ZZ * y, 4 * C2_ZZ * z
        out[7, 0], out[7, 1], out[7, 2] = -C2_XY * z, 0.0, -C2_XY * x
        out[8, 0], out[8, 1], out[8, 2] = 2 * C2_XX * x, -2 * C2_XX * y, 0.0
        if degree > 2:
            out[9, 0], out[9, 1], out[9, 2] = -6 * C3_3 * x * y, -3 * C3_3 * (xx - yy), 0.0
            out[10, 0], out[10, 1], out[10, 2] = C3_2 * y * z, C3_2 * x * z, C3_2 * x * y
            out[11, 0], out[11, 1] = 2 * C3_1 * x * y, -C3_1 * (4 * zz - xx - 3 * yy)
            out[11, 2] = -8 * C3_1 * y * z
            out[12, 0], out[12, 1] = -6 * C3_0 * x * z, -6 * C3_0 * y * z
            out[12, 2] = C3_0 * (6 * zz - 3 * xx - 3 * yy)
            out[13, 0], out[13, 1] = -C3_1 * (4 * zz - 3 * xx - yy), 2 * C3_1 * x * y
            out[13, 2] = -8 * C3_1 * x * z
            out[14, 0], out[14, 1], out[14, 2] = 2 * C3_XX * x * z, -2 * C3_XX * y * z, C3_XX * (xx - yy)
            out[15, 0], out[15, 1], out[15, 2] = -3 * C3_3 * (xx - yy), 6 * C3_3 * x * y, 0.0
