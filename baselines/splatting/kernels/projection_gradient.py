# Numba infers the types of kernels.
# mypy: allow-untyped-defs
"""The gradient of projection: from moments per splat back to every parameter of every Gaussian.

    dloss/dA = -Q M Q A,      M = sum_p w_p d_p d_p^T,      w = dloss/dsigma

for A = J W R S, whose A A^T + 0.3 I is the screen-space covariance of `geometry.py`; Q is its inverse, d_p is pixel p
minus the splat's centre, and sigma = d^T Q d / 2. From there the chain rule leads through J, R and S.
"""

import math

import numpy as np
from numba import prange

from baselines.splatting.kernels.constants import CONIC_SCALE, LOW_PASS
from baselines.splatting.kernels.geometry import (
    SMALLEST_NORM,
    clamped_slope,
    covariance,
    cross,
    exp64,
    projection_rows,
    rotation,
    sigmoid,
    times_matrix,
    to_camera,
    unit_quaternion,
)
from baselines.splatting.kernels.jit import exact_kernel, inlined
from baselines.splatting.kernels.projection import CHUNKS
from baselines.splatting.kernels.spherical_harmonics import basis, basis_gradient

# Summed over pixels, with sigma in alpha = opacity exp(-sigma), w = dloss/dsigma and (dx, dy) = pixel - splat centre:
# w, w dx, w dy, w dx^2, w dx dy, w dy^2, |w u|, |w (L21 u + L22 v)|, and dloss/dred, dloss/dgreen, dloss/dblue a set.
ABS_X, ABS_Y, TO_COLOURS = 6, 7, 8
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
def column_gradient(a, b, p, q, xx, xy, yy, determinant, m_xx, m_xy, m_yy):
    """Gradient by one column (a, b) of J W R S, and by the logarithm of its scale.

    With Q the inverse covariance it is -Q M Q (a, b), M the second moments. (p, q) = Q (a, b) is given, since its
    entries, taken from the covariance's, would cancel for long needles.
    """
    v, w = m_xx * p + m_xy * q, m_xy * p + m_yy * q
    return -(yy * v - xy * w) / determinant, -(xx * w - xy * v) / determinant, -(p * v + q * w)


@exact_kernel
def project_gradient(
    means, quaternions, log_scales, opacity_logits, sh, degree, pose, centre, lens, width, height, antialiased,
    rank, pair_start, pair_slot, pair_moments,
    g_means, g_quaternions, g_log_scales, g_opacity_logits, g_sh, g_means2d, g_means2d_absolute,
):  # fmt: skip
    """Gather each Gaussian's moments from its tiles and carry them back through the projection.

    The gathering order is the Gaussian's own, so no atomics are needed and the sum is always the same.

    Args:
        means ... antialiased: what `project` was given, sh [L, N, K, 3] with L sets of coefficients.
        rank: place in the depth order [N], negative for culled Gaussians, whose gradients become zero.
        pair_start: [n + 1], first (splat, tile) pair of each place.
        pair_slot: row of `pair_moments` that holds each pair.
        pair_moments: [pairs, 8 + 3 L] from `blend_gradient`.
        g_...: output, as the parameters; g_means2d [N, 2] is by the position on the image, in pixels, and
            g_means2d_absolute [N, 2] the sum over pixels of its absolute value.
    """
    n = means.shape[0]
    fx, fy, cx, cy = lens[0], lens[1], lens[2], lens[3]
    used = (degree + 1) * (degree + 1)
    for chunk in prange(CHUNKS):
        values = np.empty(16, np.float64)
        slopes = np.empty((16, 3), np.float64)
        moments = np.empty(pair_moments.shape[1], np.float64)
        for i in range(chunk * n // CHUNKS, (chunk + 1) * n // CHUNKS):
            place = rank[i]
            if place < 0:
                g_means[i] = 0.0
                g_quaternions[i] = 0.0
                g_log_scales[i] = 0.0
                g_opacity_logits[i] = 0.0
                for sh_set in range(sh.shape[0]):
                    g_sh[sh_set, i] = 0.0
                g_means2d[i] = 0.0
                g_means2d_absolute[i] = 0.0
                continue
            moments[:] = 0.0
            for pair in range(pair_start[place], pair_start[place + 1]):
                slot = pair_slot[pair]
                for k in range(pair_moments.shape[1]):
                    moments[k] += pair_moments[slot, k]

            # the forward pass again
            px, py, pz = np.float64(means[i, 0]), np.float64(means[i, 1]), np.float64(means[i, 2])
            x, y, z = to_camera(pose, px, py, pz)
            inverse_z = 1.0 / z
            slope_x, slope_y = x * inverse_z, y * inverse_z
            kept_x, kept_y = clamped_slope(slope_x, fx, cx, width), clamped_slope(slope_y, fy, cy, height)
            t = projection_rows(pose, fx, fy, inverse_z, kept_x, kept_y)
            qw, qx, qy, qz, norm = unit_quaternion(quaternions, i)
            r = rotation(qw, qx, qy, qz)
            s0, s1 = exp64(np.float64(log_scales[i, 0])), exp64(np.float64(log_scales[i, 1]))
            s2 = exp64(np.float64(log_scales[i, 2]))
            ra = times_matrix(t[0], t[1], t[2], r)
            rb = times_matrix(t[3], t[4], t[5], r)
            a0, a1, a2 = ra[0] * s0, ra[1] * s1, ra[2] * s2
            b0, b1, b2 = rb[0] * s0, rb[1] * s1, rb[2] * s2
            xx, xy, yy, determinant, sharp = covariance(a0, a1, a2, b0, b1, b2)

            # position on the image
            g_column = -(yy * moments[1] - xy * moments[2]) / determinant
            g_row = -(xx * moments[2] - xy * moments[1]) / determinant

            # covariance to its rows a and b and the scales; a (b.b) - b (a.b) = b x (a x b)
            c0, c1, c2 = cross(a0, a1, a2, b0, b1, b2)
            d0, d1, d2 = cross(b0, b1, b2, c0, c1, c2)
            e0, e1, e2 = cross(c0, c1, c2, a0, a1, a2)
            p0, p1, p2 = (
                (d0 + LOW_PASS * a0) / determinant,
                (d1 + LOW_PASS * a1) / determinant,
                (d2 + LOW_PASS * a2) / determinant,
            )
            q0, q1, q2 = (
                (e0 + LOW_PASS * b0) / determinant,
                (e1 + LOW_PASS * b1) / determinant,
                (e2 + LOW_PASS * b2) / determinant,
            )
            m3, m4, m5 = moments[3], moments[4], moments[5]
            ga0, gb0, gs0 = column_gradient(a0, b0, p0, q0, xx, xy, yy, determinant, m3, m4, m5)
            ga1, gb1, gs1 = column_gradient(a1, b1, p1, q1, xx, xy, yy, determinant, m3, m4, m5)
            ga2, gb2, gs2 = column_gradient(a2, b2, p2, q2, xx, xy, yy, determinant, m3, m4, m5)
            if (
                antialiased
            ):  # the opacity's factor: half the logarithms of the determinants before and after the low pass
                fainter, sharper = moments[0], -moments[0] / sharp
                ha0, ha1, ha2 = fainter * p0 + sharper * d0, fainter * p1 + sharper * d1, fainter * p2 + sharper * d2
                hb0, hb1, hb2 = fainter * q0 + sharper * e0, fainter * q1 + sharper * e1, fainter * q2 + sharper * e2
                ga0, ga1, ga2, gb0, gb1, gb2 = ga0 + ha0, ga1 + ha1, ga2 + ha2, gb0 + hb0, gb1 + hb1, gb2 + hb2
                gs0, gs1, gs2 = gs0 + a0 * ha0 + b0 * hb0, gs1 + a1 * ha1 + b1 * hb1, gs2 + a2 * ha2 + b2 * hb2
            g_log_scales[i, 0], g_log_scales[i, 1], g_log_scales[i, 2] = gs0, gs1, gs2

            # rotation: dloss/dR = (J W)^T (ga; gb) S
            ga0, ga1, ga2, gb0, gb1, gb2 = ga0 * s0, ga1 * s1, ga2 * s2, gb0 * s0, gb1 * s1, gb2 * s2
            g_r = (
                t[0] * ga0 + t[3] * gb0, t[0] * ga1 + t[3] * gb1, t[0] * ga2 + t[3] * gb2,
                t[1] * ga0 + t[4] * gb0, t[1] * ga1 + t[4] * gb1, t[1] * ga2 + t[4] * gb2,
                t[2] * ga0 + t[5] * gb0, t[2] * ga1 + t[5] * gb1, t[2] * ga2 + t[5] * gb2,
            )  # fmt: skip
            h = quaternion_gradient(g_r, qw, qx, qy, qz)
            if norm > SMALLEST_NORM:
                along = h[0] * qw + h[1] * qx + h[2] * qy + h[3] * qz
                g_quaternions[i, 0] = (h[0] - along * qw) / norm
                g_quaternions[i, 1] = (h[1] - along * qx) / norm
                g_quaternions[i, 2] = (h[2] - along * qy) / norm
                g_quaternions[i, 3] = (h[3] - along * qz) / norm
            else:
                g_quaternions[i] = 0.0

            # J: dloss/dJ = dloss/d(J W) W^T with dloss/d(J W) = (ga; gb) S R^T
            p0 = ga0 * r[0] + ga1 * r[1] + ga2 * r[2]
            p1 = ga0 * r[3] + ga1 * r[4] + ga2 * r[5]
            p2 = ga0 * r[6] + ga1 * r[7] + ga2 * r[8]
            g_j00 = p0 * pose[0, 0] + p1 * pose[0, 1] + p2 * pose[0, 2]
            g_j02 = p0 * pose[2, 0] + p1 * pose[2, 1] + p2 * pose[2, 2]
            p0 = gb0 * r[0] + gb1 * r[1] + gb2 * r[2]
            p1 = gb0 * r[3] + gb1 * r[4] + gb2 * r[5]
            p2 = gb0 * r[6] + gb1 * r[7] + gb2 * r[8]
            g_j11 = p0 * pose[1, 0] + p1 * pose[1, 1] + p2 * pose[1, 2]
            g_j12 = p0 * pose[2, 0] + p1 * pose[2, 1] + p2 * pose[2, 2]

            # J = [[fx / z, 0, -fx kept_x / z], [0, fy / z, -fy kept_y / z]]; kept_x = x / z unless clamped
            square = inverse_z * inverse_z
            g_x = fx * inverse_z * g_column
            g_y = fy * inverse_z * g_row
            g_z = -(slope_x * g_x + slope_y * g_y) - square * (fx * g_j00 + fy * g_j11)
            g_z += square * (fx * kept_x * g_j02 + fy * kept_y * g_j12)
            if kept_x == slope_x:
                g_x -= fx * square * g_j02
                g_z += fx * slope_x * square * g_j02
            if kept_y == slope_y:
                g_y -= fy * square * g_j12
                g_z += fy * slope_y * square * g_j12
            gm0 = pose[0, 0] * g_x + pose[1, 0] * g_y + pose[2, 0] * g_z
            gm1 = pose[0, 1] * g_x + pose[1, 1] * g_y + pose[2, 1] * g_z
            gm2 = pose[0, 2] * g_x + pose[1, 2] * g_y + pose[2, 2] * g_z

            # colour: clamped at zero from below; its direction depends on the mean
            dx, dy, dz = px - centre[0], py - centre[1], pz - centre[2]
            inverse_distance = 1.0 / math.sqrt(dx * dx + dy * dy + dz * dz)
            dx, dy, dz = dx * inverse_distance, dy * inverse_distance, dz * inverse_distance
            basis(degree, dx, dy, dz, values)
            if degree > 0:
                basis_gradient(degree, dx, dy, dz, slopes)
            gd0 = gd1 = gd2 = 0.0
            for sh_set in range(sh.shape[0]):
                red = green = blue = 0.5
                for k in range(used):
                    red += values[k] * sh[sh_set, i, k, 0]
                    green += values[k] * sh[sh_set, i, k, 1]
                    blue += values[k] * sh[sh_set, i, k, 2]
                to_colour = moments[TO_COLOURS + 3 * sh_set :]
                g_red = to_colour[0] if red >= 0 else 0.0
                g_green = to_colour[1] if green >= 0 else 0.0
                g_blue = to_colour[2] if blue >= 0 else 0.0
                for k in range(used):
                    g_sh[sh_set, i, k, 0] = values[k] * g_red
                    g_sh[sh_set, i, k, 1] = values[k] * g_green
                    g_sh[sh_set, i, k, 2] = values[k] * g_blue
                for k in range(used, sh.shape[2]):
                    g_sh[sh_set, i, k, 0], g_sh[sh_set, i, k, 1], g_sh[sh_set, i, k, 2] = 0.0, 0.0, 0.0
                for k in range(1, used):
                    weight = sh[sh_set, i, k, 0] * g_red + sh[sh_set, i, k, 1] * g_green + sh[sh_set, i, k, 2] * g_blue
                    gd0 += slopes[k, 0] * weight
                    gd1 += slopes[k, 1] * weight
                    gd2 += slopes[k, 2] * weight
            if degree > 0:
                along = gd0 * dx + gd1 * dy + gd2 * dz
                gm0 += (gd0 - along * dx) * inverse_distance
                gm1 += (gd1 - along * dy) * inverse_distance
                gm2 += (gd2 - along * dz) * inverse_distance

            g_means[i, 0], g_means[i, 1], g_means[i, 2] = gm0, gm1, gm2
            g_opacity_logits[i] = -moments[0] * (1.0 - sigmoid(np.float64(opacity_logits[i])))
            g_means2d[i, 0], g_means2d[i, 1] = g_column, g_row
            l11 = math.sqrt(CONIC_SCALE * yy / determinant)
            g_means2d_absolute[i, 0] = SIGMA_PER_POWER * l11 * moments[ABS_X]
            g_means2d_absolute[i, 1] = SIGMA_PER_POWER * moments[ABS_Y]
