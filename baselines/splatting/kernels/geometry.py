# Numba infers the types of kernels.
# mypy: allow-untyped-defs
"""From a Gaussian's parameters to its ellipse on the image, in float64 scalars; shared by projection and its gradient.

    screen-space covariance = J W R S S R^T W^T J^T + 0.3 I      (EWA splatting, Zwicker et al. 2001; Kerbl et al. 2023)

With rows a and b of J W R S, three numbers each, it is [[a.a + 0.3, a.b], [a.b, b.b + 0.3]], and the Lagrange identity
(a.a)(b.b) - (a.b)^2 = |a x b|^2 gives its determinant without cancellation even for needles seen along their length.
"""

import math

import numpy as np

from baselines.splatting.kernels.constants import FRUSTUM_MARGIN, LOG2_E, LOW_PASS
from baselines.splatting.kernels.jit import inlined

_NODES = np.cos((np.arange(256) + 0.5) * np.pi / 256) / 2
_POLYNOMIAL = np.polynomial.polynomial.polyfit(_NODES, 2.0**_NODES, 10)
EXP2_COEFFICIENTS = tuple(float(c) for c in _POLYNOMIAL)[::-1]
ROUND = 6755399441055744.0  # 1.5 * 2^52: adding it leaves the nearest integer in the low bits of a float64
SMALLEST_NORM = 1e-12  # a quaternion shorter than this counts as no rotation


@inlined
def exp64(x):
    """exp(x) within 1e-13 relative, saturating at 2^-1000 and 2^1000, without a library call; NaN stays NaN."""
    exponent = x * LOG2_E
    if exponent == exponent:
        exponent = min(max(exponent, -1000.0), 1000.0)
    shifted = exponent + ROUND
    whole = np.float64(shifted).view(np.int64) << np.int64(52)
    fraction = exponent - (shifted - ROUND)
    power = 0.0
    for coefficient in EXP2_COEFFICIENTS:
        power = power * fraction + coefficient
    return np.int64(np.float64(power).view(np.int64) + whole).view(np.float64)


@inlined
def sigmoid(x):
    """1 / (1 + exp(-x))."""
    return 1.0 / (1.0 + exp64(-x))


@inlined
def unit_quaternion(quaternions, i):
    """(w, x, y, z) of row i at length one, and its length before."""
    w, x = np.float64(quaternions[i, 0]), np.float64(quaternions[i, 1])
    y, z = np.float64(quaternions[i, 2]), np.float64(quaternions[i, 3])
    norm = math.sqrt(w * w + x * x + y * y + z * z)
    inverse = 1.0 / max(norm, SMALLEST_NORM)
    return w * inverse, x * inverse, y * inverse, z * inverse, norm


@inlined
def rotation(w, x, y, z):
    """Rotation matrix of a unit quaternion, row by row."""
    return (
        1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
        2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
        2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
    )  # fmt: skip


@inlined
def to_camera(pose, x, y, z):
    """A point in camera coordinates."""
    return (
        pose[0, 0] * x + pose[0, 1] * y + pose[0, 2] * z + pose[0, 3],
        pose[1, 0] * x + pose[1, 1] * y + pose[1, 2] * z + pose[1, 3],
        pose[2, 0] * x + pose[2, 1] * y + pose[2, 2] * z + pose[2, 3],
    )


@inlined
def clamped_slope(slope, focal, centre, size):
    """x / z (or y / z) kept within the image and a margin, where the linearised projection still makes sense."""
    margin = FRUSTUM_MARGIN * size / focal
    return min(max(slope, -centre / focal - margin), (size - centre) / focal + margin)


@inlined
def projection_rows(pose, fx, fy, inverse_z, slope_x, slope_y):
    """The two rows of J W: how the pixel moves with the world point, linearised at (slope_x z, slope_y z, z)."""
    j00, j02 = fx * inverse_z, -fx * slope_x * inverse_z
    j11, j12 = fy * inverse_z, -fy * slope_y * inverse_z
    return (
        j00 * pose[0, 0] + j02 * pose[2, 0], j00 * pose[0, 1] + j02 * pose[2, 1], j00 * pose[0, 2] + j02 * pose[2, 2],
        j11 * pose[1, 0] + j12 * pose[2, 0], j11 * pose[1, 1] + j12 * pose[2, 1], j11 * pose[1, 2] + j12 * pose[2, 2],
    )  # fmt: skip


@inlined
def times_matrix(t0, t1, t2, m):
    """A row vector times a 3x3 matrix given row by row."""
    return (
        t0 * m[0] + t1 * m[3] + t2 * m[6],
        t0 * m[1] + t1 * m[4] + t2 * m[7],
        t0 * m[2] + t1 * m[5] + t2 * m[8],
    )


@inlined
def cross(a0, a1, a2, b0, b1, b2):
    """Cross product of two vectors."""
    return a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0


@inlined
def covariance(a0, a1, a2, b0, b1, b2):
    """xx, xy and yy of the low-passed screen covariance from the rows a and b of J W R S, its determinant, and the
    determinant before the low pass.
    """
    xx = a0 * a0 + a1 * a1 + a2 * a2
    xy = a0 * b0 + a1 * b1 + a2 * b2
    yy = b0 * b0 + b1 * b1 + b2 * b2
    c0, c1, c2 = cross(a0, a1, a2, b0, b1, b2)
    sharp = c0 * c0 + c1 * c1 + c2 * c2
    return xx + LOW_PASS, xy, yy + LOW_PASS, sharp + LOW_PASS * (xx + yy) + LOW_PASS * LOW_PASS, sharp
