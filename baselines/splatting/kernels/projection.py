# Numba infers the types of kernels.
# mypy: allow-untyped-defs
"""Gaussians to splats: position, shape, opacity and colour on the image, or culled.

    u = L11 dx + L21 dy,   v = L22 dy,   alpha = 2^(LOG2_OPACITY - u^2 - v^2)

for a pixel (dx, dy) away from the splat's centre. A splat is nine float32 numbers, and three for a colour of each set.
Its shape, L, is the Cholesky factor of the inverse covariance, scaled. That takes one multiply-add per pixel, does not
cancel for needles, and bounds the pixels it reaches exactly: u^2 + v^2 <= CUTOFF = log2(255 opacity) is where alpha is
at least 1/255.
"""

import math

import numpy as np
from numba import prange

from baselines.splatting.kernels.constants import CONIC_SCALE, FAR, MIN_ALPHA
from baselines.splatting.kernels.geometry import (
    clamped_slope,
    covariance,
    exp64,
    projection_rows,
    rotation,
    sigmoid,
    times_matrix,
    to_camera,
    unit_quaternion,
)
from baselines.splatting.kernels.jit import exact_kernel
from baselines.splatting.kernels.spherical_harmonics import basis

X, Y, L11, L21, L22, LOG2_OPACITY, CUTOFF, HALF_HEIGHT, HALF_WIDTH, COLOURS = range(10)

CHUNKS = 64
CULLED = np.float32(np.inf)  # the depth of a Gaussian that this view does not show


@exact_kernel
def project(
    means, quaternions, log_scales, opacity_logits, sh, degree, pose, centre, lens, width, height, near, antialiased,
    splats, depths,
):  # fmt: skip
    """Fill splats [N, 9 + 3 L] and depths [N].

    Culled, with an infinite depth: centre nearer than `near`, nowhere at least 1/255 opaque, wholly outside the image,
    or any parameter that leads to a number which is not finite.

    Args:
        means, quaternions, log_scales, opacity_logits: parameters, float32, as in `Gaussians`.
        sh: L sets of coefficients [L, N, K, 3]; the colours are those of `Gaussians` in all.
        degree: spherical-harmonic degree to use, at most what sh holds.
        pose: world-to-camera matrix [4, 4], float64.
        centre: camera position [3], float64.
        lens: fx, fy, cx, cy, float64 [4].
        width, height: image size in pixels.
        near: nearest depth shown, in world units.
        antialiased: whether a splat that the low pass widens becomes as much fainter, by the square root of the
            determinants' ratio (the 2D filter of Yu et al. 2024, Mip-Splatting).
        splats, depths: output.
    """
    n = means.shape[0]
    fx, fy, cx, cy = lens[0], lens[1], lens[2], lens[3]
    for chunk in prange(CHUNKS):
        values = np.empty(16, np.float64)
        for i in range(chunk * n // CHUNKS, (chunk + 1) * n // CHUNKS):
            depths[i] = CULLED
            px, py, pz = np.float64(means[i, 0]), np.float64(means[i, 1]), np.float64(means[i, 2])
            x, y, z = to_camera(pose, px, py, pz)
            if not (near < z < FAR):  # false for NaN
                continue
            opacity = sigmoid(np.float64(opacity_logits[i]))
            if not opacity > MIN_ALPHA:
                continue

            inverse_z = 1.0 / z
            slope_x, slope_y = x * inverse_z, y * inverse_z
            column, row = fx * slope_x + cx, fy * slope_y + cy
            t = projection_rows(
                pose, fx, fy, inverse_z, clamped_slope(slope_x, fx, cx, width), clamped_slope(slope_y, fy, cy, height)
            )
            qw, qx, qy, qz, _ = unit_quaternion(quaternions, i)
            r = rotation(qw, qx, qy, qz)
            a = times_matrix(t[0], t[1], t[2], r)
            b = times_matrix(t[3], t[4], t[5], r)
            s0, s1 = exp64(np.float64(log_scales[i, 0])), exp64(np.float64(log_scales[i, 1]))
            s2 = exp64(np.float64(log_scales[i, 2]))
            xx, xy, yy, determinant, sharp = covariance(
                a[0] * s0, a[1] * s1, a[2] * s2, b[0] * s0, b[1] * s1, b[2] * s2
            )
            if antialiased:
                opacity *= math.sqrt(sharp / determinant)
                if not opacity > MIN_ALPHA:
                    continue
            cutoff = math.log2(opacity / MIN_ALPHA)
            half_width = math.sqrt(cutoff / CONIC_SCALE * xx)
            half_height = math.sqrt(cutoff / CONIC_SCALE * yy)
            in_columns = column + half_width > 0 and column - half_width < width
            if not (in_columns and row + half_height > 0 and row - half_height < height):
                continue
            l11 = math.sqrt(CONIC_SCALE * yy / determinant)
            if not (1e-30 < l11 < 1e30):
                continue

            dx, dy, dz = px - centre[0], py - centre[1], pz - centre[2]
            inverse_distance = 1.0 / math.sqrt(dx * dx + dy * dy + dz * dz)
            basis(degree, dx * inverse_distance, dy * inverse_distance, dz * inverse_distance, values)
            largest = 0.0
            for sh_set in range(sh.shape[0]):
                red = green = blue = 0.5
                for k in range((degree + 1) * (degree + 1)):
                    red += values[k] * sh[sh_set, i, k, 0]
                    green += values[k] * sh[sh_set, i, k, 1]
                    blue += values[k] * sh[sh_set, i, k, 2]
                colour = splats[i, COLOURS + 3 * sh_set :]
                colour[0], colour[1], colour[2] = max(red, 0.0), max(green, 0.0), max(blue, 0.0)
                largest += abs(red) + abs(green) + abs(blue)
            if not largest < 1e30:
                continue

            splats[i, X], splats[i, Y] = column, row
            splats[i, L11] = l11
            splats[i, L21] = -CONIC_SCALE * xy / (determinant * l11)
            splats[i, L22] = math.sqrt(CONIC_SCALE / yy)
            splats[i, LOG2_OPACITY] = math.log2(opacity)
            splats[i, CUTOFF] = cutoff
            splats[i, HALF_HEIGHT], splats[i, HALF_WIDTH] = half_height, half_width
            depths[i] = z
