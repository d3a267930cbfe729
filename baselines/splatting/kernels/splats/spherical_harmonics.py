# Numba infers the types of kernels.
# mypy: allow-untyped-defs
"""Real spherical harmonics up to degree 3, in the order and with the signs that 3DGS files use.

    colour = 0.5 + sum_k coefficient_k basis_k(direction)

with k = l (l + 1) + m for degree l and order m.
"""

from baselines.splatting.kernels.jit import inlined
from baselines.splatting.kernels.splats.sh_coefficients import (
    C0,
    C1,
    C2_XX,
    C2_XY,
    C2_ZZ,
    C3_0,
    C3_1,
    C3_2,
    C3_3,
    C3_XX,
)
from baselines.splatting.kernels.vector.memory import load64, store64
from baselines.splatting.kernels.vector.vectors import LANES64


@inlined
def basis(degree, x, y, z, out):
    """Values at unit vectors (x, y, z) into out [>= (degree + 1)^2, LANES64], flat, float32."""
    store64(C0, out, 0)
    if degree > 0:
        store64(-C1 * y, out, LANES64)
        store64(C1 * z, out, 2 * LANES64)
        store64(-C1 * x, out, 3 * LANES64)
    if degree > 1:
        xx, yy, zz = x * x, y * y, z * z
        store64(C2_XY * x * y, out, 4 * LANES64)
        store64(-C2_XY * y * z, out, 5 * LANES64)
        store64(C2_ZZ * (2 * zz - xx - yy), out, 6 * LANES64)
        store64(-C2_XY * x * z, out, 7 * LANES64)
        store64(C2_XX * (xx - yy), out, 8 * LANES64)
        if degree > 2:
            store64(-C3_3 * y * (3 * xx - yy), out, 9 * LANES64)
            store64(C3_2 * x * y * z, out, 10 * LANES64)
            store64(-C3_1 * y * (4 * zz - xx - yy), out, 11 * LANES64)
            store64(C3_0 * z * (2 * zz - 3 * xx - 3 * yy), out, 12 * LANES64)
            store64(-C3_1 * x * (4 * zz - xx - yy), out, 13 * LANES64)
            store64(C3_XX * z * (xx - yy), out, 14 * LANES64)
            store64(-C3_3 * x * (xx - 3 * yy), out, 15 * LANES64)


@inlined
def colour(degree, values, coefficients):
    """Red, green and blue, not clamped, of `basis` values and coefficients [>= (degree + 1)^2, 3, LANES64], flat.

    The finest details come first: they are the smallest, and float32 keeps most of them that way.
    """
    red = green = blue = load64(values, 0) * 0
    for k in range((degree + 1) * (degree + 1) - 1, -1, -1):
        value = load64(values, k * LANES64)
        red = red + value * load64(coefficients, 3 * k * LANES64)
        green = green + value * load64(coefficients, (3 * k + 1) * LANES64)
        blue = blue + value * load64(coefficients, (3 * k + 2) * LANES64)
    return red + 0.5, green + 0.5, blue + 0.5


@inlined
def direction_gradient(degree, x, y, z, weights):
    """sum_k weight_k dbasis_k/d(x, y, z), of degrees 1 to 3; weights [>= (degree + 1)^2, LANES64], flat; the first is
    not used."""
    w = weights
    w1, w2, w3 = load64(w, LANES64), load64(w, 2 * LANES64), load64(w, 3 * LANES64)
    by_x, by_y, by_z = -C1 * w3, -C1 * w1, C1 * w2
    if degree > 1:
        w4, w5, w6 = load64(w, 4 * LANES64), load64(w, 5 * LANES64), load64(w, 6 * LANES64)
        w7, w8 = load64(w, 7 * LANES64), load64(w, 8 * LANES64)
        by_x = by_x + C2_XY * (y * w4 - z * w7) - 2 * C2_ZZ * x * w6 + 2 * C2_XX * x * w8
        by_y = by_y + C2_XY * (x * w4 - z * w5) - 2 * C2_ZZ * y * w6 - 2 * C2_XX * y * w8
        by_z = by_z - C2_XY * (y * w5 + x * w7) + 4 * C2_ZZ * z * w6
        if degree > 2:
            xx, yy, zz = x * x, y * y, z * z
            xy, xz, yz = x * y, x * z, y * z
            w9, w10, w11 = load64(w, 9 * LANES64), load64(w, 10 * LANES64), load64(w, 11 * LANES64)
            w12, w13 = load64(w, 12 * LANES64), load64(w, 13 * LANES64)
            w14, w15 = load64(w, 14 * LANES64), load64(w, 15 * LANES64)
            by_x = by_x - 3 * C3_3 * (2 * xy * w9 + (xx - yy) * w15) + C3_2 * yz * w10 - 6 * C3_0 * xz * w12
            by_x = by_x + C3_1 * (2 * xy * w11 - (4 * zz - 3 * xx - yy) * w13) + 2 * C3_XX * xz * w14
            by_y = by_y + 3 * C3_3 * (2 * xy * w15 - (xx - yy) * w9) + C3_2 * xz * w10 - 6 * C3_0 * yz * w12
            by_y = by_y + C3_1 * (2 * xy * w13 - (4 * zz - xx - 3 * yy) * w11) - 2 * C3_XX * yz * w14
            by_z = by_z + C3_2 * xy * w10 - 8 * C3_1 * (yz * w11 + xz * w13)
            by_z = by_z + C3_0 * (6 * zz - 3 * xx - 3 * yy) * w12 + C3_XX * (xx - yy) * w14
    return by_x, by_y, by_z
