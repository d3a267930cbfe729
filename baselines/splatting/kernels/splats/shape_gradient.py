# Numba infers the types of kernels.
# mypy: allow-untyped-defs
"""From what the loss gains by a splat's position and shape to what it gains by the Gaussian's, in float64.

    sigma = ln 2 (u^2 + v^2),    (u, v) = L (pixel - centre),    w = -dloss/dsigma,    k = 2 ln 2
    dloss/dcentre = k L^T sum_p w_p (u_p, v_p)
    dloss/dA = k^2 L^T S L A,    S = sum_p w_p (u_p, v_p) (u_p, v_p)^T

for A = J W R S, whose A A^T + 0.3 I = (k L^T L)^-1 is the screen-space covariance of `geometry.py`; p are pixels. From
there the chain rule leads through J, R and S. The sums are the moments of `projection_gradient.py`.
"""

import math

from baselines.splatting.kernels.constants import LOW_PASS
from baselines.splatting.kernels.jit import inlined
from baselines.splatting.kernels.splats.geometry import (
    SMALLEST_NORM,
    axes_on_screen,
    covariance,
    cross,
    linearised,
    rotation,
    times_matrix,
    unit_quaternion,
)
from baselines.splatting.kernels.splats.projection import read_shapes
from baselines.splatting.kernels.vector.memory import load64, store64
from baselines.splatting.kernels.vector.vectors import LANES64, select, to_float32, to_float64

# Columns of a row of moments, each summed over the pixels of a splat in a tile: w, w u, w v, w u^2, w u v, w v^2,
# |w u|, |(L21 / L22) w u + w v|, and dloss/dred, dloss/dgreen, dloss/dblue a set.
W, WU, WV, WUU, WUV, WVV, ABS_U, ABS_V, TO_COLOURS = range(9)
# Columns of what a batch of Gaussians hands on: gradients by each parameter but the colours, and by the position on
# the image.
MEANS, QUATERNIONS, SCALES, LOGIT, MEANS2D, ABSOLUTE, GRADIENTS = 0, 3, 7, 10, 11, 13, 15
SIGMA_PER_POWER = 2 * math.log(2)  # dsigma/du = 2 ln 2 u, as sigma = ln 2 (u^2 + v^2)


@inlined
def quaternion_gradient(n, w, x, y, z):
    """Gradient by an unconstrained quaternion of R(w, x, y, z), given n = dloss/dR row by row."""
    return (
        2 * (x * (n[7] - n[5]) + y * (n[2] - n[6]) + z * (n[3] - n[1])),
        2 * (-2 * x * (n[4] + n[8]) + y * (n[3] + n[1]) + z * (n[6] + n[2]) + w * (n[7] - n[5])),
        2 * (x * (n[3] + n[1]) - 2 * y * (n[0] + n[8]) + z * (n[7] + n[5]) + w * (n[2] - n[6])),
        2 * (x * (n[6] + n[2]) + y * (n[7] + n[5]) - 2 * z * (n[0] + n[4]) + w * (n[3] - n[1])),
    )


@inlined
def column_gradient(a, b, d, l11, l21, l22, wuu, wuv, wvv):
    """Gradient by one column (a, b) of J W R S, and by the logarithm of its scale; d is that column of b x (a x b).

    L (a, b) = (alpha, beta) comes of d, which does not cancel for long needles.
    """
    alpha, beta = SIGMA_PER_POWER * l11 * l22 * l22 * (d + LOW_PASS * a), l22 * b
    su, sv = wuu * alpha + wuv * beta, wuv * alpha + wvv * beta
    square = SIGMA_PER_POWER * SIGMA_PER_POWER
    return square * l11 * su, square * (l21 * su + l22 * sv), square * (alpha * su + beta * sv)


@inlined
def moment(moments, column):
    """One moment of LANES64 splats in float64."""
    return to_float64(load64(moments, column * LANES64))


@inlined
def fade_gradient(w, a, b, d, e, determinant, sharp):
    """Gradient by one column (a, b) of the factor by which an antialiased splat is fainter: half of the logarithms of
    the determinants before and after the low pass."""
    return (
        w * (d / sharp - (d + LOW_PASS * a) / determinant),
        w * (e / sharp - (e + LOW_PASS * b) / determinant),
    )


@inlined
def shape_gradient(means, quaternions, log_scales, rows, pose, lens, width, height, antialiased, factor, m, out):
    """Carry moments `m` of splats with L = `factor` back to rotations and scales, into columns of `out`.

    Returns:
        The gradient by the means, without what the colours add.
    """
    l11, l21, l22 = factor
    # the forward pass again
    fx, fy = lens[0], lens[1]
    mean, quaternion, (s0, s1, s2) = read_shapes(means, quaternions, log_scales, rows)
    z, slope_x, slope_y, kept_x, kept_y, t = linearised(pose, lens, width, height, *mean)
    inverse_z = 1.0 / z
    qw, qx, qy, qz, norm = unit_quaternion(*quaternion)
    r = rotation(qw, qx, qy, qz)
    a0, a1, a2, b0, b1, b2 = axes_on_screen(t, r, (s0, s1, s2))

    # position on the image
    wu, wv = moment(m, WU), moment(m, WV)
    g_column, g_row = SIGMA_PER_POWER * l11 * wu, SIGMA_PER_POWER * (l21 * wu + l22 * wv)
    store64(to_float32(g_column), out, MEANS2D * LANES64)
    store64(to_float32(g_row), out, (MEANS2D + 1) * LANES64)
    store64(to_float32(SIGMA_PER_POWER * l11 * moment(m, ABS_U)), out, ABSOLUTE * LANES64)
    store64(to_float32(SIGMA_PER_POWER * l22 * moment(m, ABS_V)), out, (ABSOLUTE + 1) * LANES64)

    # covariance to its rows a and b and the scales; a (b.b) - b (a.b) = b x (a x b)
    c0, c1, c2 = cross(a0, a1, a2, b0, b1, b2)
    d0, d1, d2 = cross(b0, b1, b2, c0, c1, c2)
    wuu, wuv, wvv = moment(m, WUU), moment(m, WUV), moment(m, WVV)
    ga0, gb0, gs0 = column_gradient(a0, b0, d0, l11, l21, l22, wuu, wuv, wvv)
    ga1, gb1, gs1 = column_gradient(a1, b1, d1, l11, l21, l22, wuu, wuv, wvv)
    ga2, gb2, gs2 = column_gradient(a2, b2, d2, l11, l21, l22, wuu, wuv, wvv)
    if antialiased:
        e0, e1, e2 = cross(c0, c1, c2, a0, a1, a2)
        _, _, _, determinant, sharp = covariance(a0, a1, a2, b0, b1, b2)
        w = moment(m, W)
        ha0, hb0 = fade_gradient(w, a0, b0, d0, e0, determinant, sharp)
        ha1, hb1 = fade_gradient(w, a1, b1, d1, e1, determinant, sharp)
        ha2, hb2 = fade_gradient(w, a2, b2, d2, e2, determinant, sharp)
        ga0, ga1, ga2, gb0, gb1, gb2 = ga0 + ha0, ga1 + ha1, ga2 + ha2, gb0 + hb0, gb1 + hb1, gb2 + hb2
        gs0, gs1, gs2 = gs0 + a0 * ha0 + b0 * hb0, gs1 + a1 * ha1 + b1 * hb1, gs2 + a2 * ha2 + b2 * hb2
    store64(to_float32(gs0), out, SCALES * LANES64)
    store64(to_float32(gs1), out, (SCALES + 1) * LANES64)
    store64(to_float32(gs2), out, (SCALES + 2) * LANES64)

    # rotation: dloss/dR = (J W)^T (ga; gb) S
    ga0, ga1, ga2, gb0, gb1, gb2 = ga0 * s0, ga1 * s1, ga2 * s2, gb0 * s0, gb1 * s1, gb2 * s2
    g_r = (
        t[0] * ga0 + t[3] * gb0, t[0] * ga1 + t[3] * gb1, t[0] * ga2 + t[3] * gb2,
        t[1] * ga0 + t[4] * gb0, t[1] * ga1 + t[4] * gb1, t[1] * ga2 + t[4] * gb2,
        t[2] * ga0 + t[5] * gb0, t[2] * ga1 + t[5] * gb1, t[2] * ga2 + t[5] * gb2,
    )  # fmt: skip
    h0, h1, h2, h3 = quaternion_gradient(g_r, qw, qx, qy, qz)
    along = h0 * qw + h1 * qx + h2 * qy + h3 * qz
    inverse_norm = select(norm > SMALLEST_NORM, 1.0 / norm, 0.0)
    store64(to_float32((h0 - along * qw) * inverse_norm), out, QUATERNIONS * LANES64)
    store64(to_float32((h1 - along * qx) * inverse_norm), out, (QUATERNIONS + 1) * LANES64)
    store64(to_float32((h2 - along * qy) * inverse_norm), out, (QUATERNIONS + 2) * LANES64)
    store64(to_float32((h3 - along * qz) * inverse_norm), out, (QUATERNIONS + 3) * LANES64)

    # J: dloss/dJ = dloss/d(J W) W^T with dloss/d(J W) = (ga; gb) S R^T
    transposed = (r[0], r[3], r[6], r[1], r[4], r[7], r[2], r[5], r[8])
    p0, p1, p2 = times_matrix(ga0, ga1, ga2, transposed)
    q0, q1, q2 = times_matrix(gb0, gb1, gb2, transposed)
    g_j00 = p0 * pose[0, 0] + p1 * pose[0, 1] + p2 * pose[0, 2]
    g_j02 = p0 * pose[2, 0] + p1 * pose[2, 1] + p2 * pose[2, 2]
    g_j11 = q0 * pose[1, 0] + q1 * pose[1, 1] + q2 * pose[1, 2]
    g_j12 = q0 * pose[2, 0] + q1 * pose[2, 1] + q2 * pose[2, 2]

    # J = [[fx / z, 0, -fx kept_x / z], [0, fy / z, -fy kept_y / z]]; kept_x = x / z unless clamped
    square = inverse_z * inverse_z
    g_x, g_y = fx * inverse_z * g_column, fy * inverse_z * g_row
    g_z = -(slope_x * g_x + slope_y * g_y) - square * (fx * g_j00 + fy * g_j11)
    g_z = g_z + square * (fx * kept_x * g_j02 + fy * kept_y * g_j12)
    free_x = select(kept_x == slope_x, fx * square * g_j02, 0.0)
    free_y = select(kept_y == slope_y, fy * square * g_j12, 0.0)
    g_x, g_y, g_z = g_x - free_x, g_y - free_y, g_z + slope_x * free_x + slope_y * free_y
    return (
        pose[0, 0] * g_x + pose[1, 0] * g_y + pose[2, 0] * g_z,
        pose[0, 1] * g_x + pose[1, 1] * g_y + pose[2, 1] * g_z,
        pose[0, 2] * g_x + pose[1, 2] * g_y + pose[2, 2] * g_z,
    )
