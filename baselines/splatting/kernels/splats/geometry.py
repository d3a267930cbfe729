# Numba infers the types of kernels.
# mypy: allow-untyped-defs
"""From a Gaussian's parameters to its ellipse on the image, in float64; shared by projection and its gradient.

All of it takes numbers, or vectors of `vectors.py`.

    screen-space covariance = J W R S S R^T W^T J^T + 0.3 I      (EWA splatting, Zwicker et al. 2001; Kerbl et al. 2023)

With rows a and b of J W R S, three numbers each, it is [[a.a + 0.3, a.b], [a.b, b.b + 0.3]], and the Lagrange identity
(a.a)(b.b) - (a.b)^2 = |a x b|^2 gives its determinant without cancellation even for needles seen along their length.
"""

import math
import struct

import numpy as np

from baselines.splatting.kernels.constants import FRUSTUM_MARGIN, LOG2_E, LOW_PASS
from baselines.splatting.kernels.jit import inlined
from baselines.splatting.kernels.vector.vectors import from_bits, maximum, minimum, square_root, to_bits

_NODES = np.cos((np.arange(256) + 0.5) * np.pi / 256) / 2
# of 2^f for f in [-1/2, 1/2], the highest power first
EXP2_HIGHEST, *_REST = (float(c) for c in np.polynomial.polynomial.polyfit(_NODES, 2.0**_NODES, 10)[::-1])
EXP2_REST = tuple(_REST)
LOG2_HIGHEST = 2 * LOG2_E / 19  # log2((1 + t) / (1 - t)) = 2 log2(e) (t + t^3 / 3 + t^5 / 5 + ...)
LOG2_REST = tuple(2 * LOG2_E / power for power in range(17, 0, -2))
ROUND = 6755399441055744.0  # 1.5 * 2^52: adding it leaves the nearest integer in the low bits of a float64
ROUND_BITS = struct.unpack("q", struct.pack("d", ROUND))[0]
SQRT_HALF_BITS = struct.unpack("q", struct.pack("d", math.sqrt(0.5)))[0]
SMALLEST_NORM = 1e-12  # a quaternion shorter than this counts as no rotation


@inlined
def exp64(x):
    """exp(x) within 1e-13 relative, saturating at 2^-1000 and 2^1000, without a library call; NaN stays NaN."""
    exponent = minimum(1000.0, maximum(-1000.0, x * LOG2_E))
    shifted = exponent + ROUND
    fraction = exponent - (shifted - ROUND)
    power = fraction * EXP2_HIGHEST + EXP2_REST[0]
    for coefficient in EXP2_REST[1:]:
        power = power * fraction + coefficient
    return from_bits(to_bits(power) + (to_bits(shifted) << 52))


@inlined
def log2(x):
    """log2(x) of positive, finite float64 that are not denormal, within 1e-15 relative to the larger of it and 1."""
    whole = (to_bits(x) - SQRT_HALF_BITS) >> 52  # x = 2^whole mantissa, with a mantissa from sqrt(1/2) to sqrt(2)
    mantissa = from_bits(to_bits(x) - (whole << 52))
    t = (mantissa - 1.0) / (mantissa + 1.0)
    square = t * t
    power = square * LOG2_HIGHEST + LOG2_REST[0]
    for coefficient in LOG2_REST[1:]:
        power = power * square + coefficient
    return power * t + (from_bits(whole + ROUND_BITS) - ROUND)


@inlined
def sigmoid(x):
    """1 / (1 + exp(-x))."""
    return 1.0 / (1.0 + exp64(-x))


@inlined
def unit_quaternion(w, x, y, z):
    """A quaternion at length one, and its length before."""
    norm = square_root(w * w + x * x + y * y + z * z)
    inverse = 1.0 / maximum(norm, SMALLEST_NORM)
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
    return minimum(maximum(slope, -centre / focal - margin), (size - centre) / focal + margin)


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
def linearised(pose, lens, width, height, x, y, z):
    """How the camera sees points of the world.

    Returns:
        z in camera coordinates; the slopes x / z and y / z; the slopes clamped; the two rows of J W.
    """
    x, y, z = to_camera(pose, x, y, z)
    inverse_z = 1.0 / z
    slope_x, slope_y = x * inverse_z, y * inverse_z
    kept_x = clamped_slope(slope_x, lens[0], lens[2], width)
    kept_y = clamped_slope(slope_y, lens[1], lens[3], height)
    return z, slope_x, slope_y, kept_x, kept_y, projection_rows(pose, lens[0], lens[1], inverse_z, kept_x, kept_y)


@inlined
def times_matrix(t0, t1, t2, m):
    """A row vector times a 3x3 matrix given row by row."""
    return (
        t0 * m[0] + t1 * m[3] + t2 * m[6],
        t0 * m[1] + t1 * m[4] + t2 * m[7],
        t0 * m[2] + t1 * m[5] + t2 * m[8],
    )


@inlined
def axes_on_screen(t, r, s):
    """The rows a and b of J W R S, one after the other, from those of J W, of R, and the three scales."""
    a = times_matrix(t[0], t[1], t[2], r)
    b = times_matrix(t[3], t[4], t[5], r)
    return a[0] * s[0], a[1] * s[1], a[2] * s[2], b[0] * s[0], b[1] * s[1], b[2] * s[2]


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
