# Numba infers the types of kernels.
# mypy: allow-untyped-defs
"""The gradient of projection: from moments per splat back to every parameter of every Gaussian.

    sigma = ln 2 (u^2 + v^2),    (u, v) = L (pixel - centre),    w = -dloss/dsigma,    k = 2 ln 2
    dloss/dcentre = k L^T sum_p w_p (u_p, v_p)
    dloss/dA = k^2 L^T S L A,    S = sum_p w_p (u_p, v_p) (u_p, v_p)^T

for A = J W R S, whose A A^T + 0.3 I = (k L^T L)^-1 is the screen-space covariance of `geometry.py`; p are pixels. From
there the chain rule leads through J, R and S.

`project_gradient` is one kernel in two forms, which its last argument chooses when it is compiled: the gradient by the
spherical harmonics is written, or Adam takes its step with it at once. It is three quarters of all gradients, and
never has to go through memory that way.
"""

import math

import numpy as np
from numba import prange

from baselines.splatting.kernels.adam import move
from baselines.splatting.kernels.constants import LOW_PASS
from baselines.splatting.kernels.geometry import (
    SMALLEST_NORM,
    axes_on_screen,
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
from baselines.splatting.kernels.projection import (
    AHEAD,
    CHUNKS,
    L11,
    L21,
    L22,
    MAX_COEFFICIENTS,
    direction,
    prefetch_row,
    read_coefficients,
)
from baselines.splatting.kernels.spherical_harmonics import basis, colour, direction_gradient
from baselines.splatting.kernels.vector_memory import gather, load, load64, store, store64, transpose
from baselines.splatting.kernels.vectors import LANES, LANES64, select, square_root, to_float32, to_float64

# Columns of a row of moments, each summed over the pixels of a splat in a tile: w, w u, w v, w u^2, w u v, w v^2, |w u|,
# |(L21 / L22) w u + w v|, and dloss/dred, dloss/dgreen, dloss/dblue a set.
W, WU, WV, WUU, WUV, WVV, ABS_U, ABS_V, TO_COLOURS = range(9)
SIGMA_PER_POWER = 2 * math.log(2)  # dsigma/du = 2 ln 2 u, as sigma = ln 2 (u^2 + v^2)
# Columns of what a batch of Gaussians hands on: gradients by each parameter but the colours.
MEANS, QUATERNIONS, SCALES, LOGIT, MEANS2D, ABSOLUTE, GRADIENTS = 0, 3, 7, 10, 11, 13, 15
NEXT = 8  # how many Gaussians ahead Adam's moments are asked for; past the end of an array that does nothing
MAX_ROW = 3 * MAX_COEFFICIENTS


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
def sum_moments(moments, size, pair_start, pair_end, slots, own, sums, out):
    """The moments of LANES64 splats, each summed over its pairs, into out [size, LANES64]."""
    for lane in range(LANES64):
        start, end = np.int64(pair_start[slots[lane]]), np.int64(pair_end[slots[lane]])
        for part in range(0, size, LANES):
            total = load(moments, start * size + part) * 0
            for pair in range(start, end):
                total = total + load(moments, pair * size + part)
            store(total, sums, lane * size + part)
    for column in range(0, size, LANES64):
        transpose(LANES64, sums, own, size, column, out, column * LANES64, LANES64)


@inlined
def fade_gradient(w, a, b, d, e, determinant, sharp):
    """Gradient by one column (a, b) of the factor by which an antialiased splat is fainter: half of the logarithms of
    the determinants before and after the low pass."""
    return (
        w * (d / sharp - (d + LOW_PASS * a) / determinant),
        w * (e / sharp - (e + LOW_PASS * b) / determinant),
    )


@inlined
def shape_gradient(means, quaternions, log_scales, rows, pose, lens, width, height, antialiased, l, m, out):
    """Carry moments `m` of splats with L = `l` back to rotations, scales and, in part, means, into columns of `out`.

    Returns:
        The gradient by the means, without what the colours add.
    """
    fx, fy, cx, cy = lens[0], lens[1], lens[2], lens[3]
    l11, l21, l22 = l
    # the forward pass again
    x, y, z = to_camera(pose, gather(means, rows, 3, 0), gather(means, rows, 3, 1), gather(means, rows, 3, 2))
    inverse_z = 1.0 / z
    slope_x, slope_y = x * inverse_z, y * inverse_z
    kept_x, kept_y = clamped_slope(slope_x, fx, cx, width), clamped_slope(slope_y, fy, cy, height)
    t = projection_rows(pose, fx, fy, inverse_z, kept_x, kept_y)
    qw, qx, qy, qz, norm = unit_quaternion(
        gather(quaternions, rows, 4, 0),
        gather(quaternions, rows, 4, 1),
        gather(quaternions, rows, 4, 2),
        gather(quaternions, rows, 4, 3),
    )
    r = rotation(qw, qx, qy, qz)
    s0 = exp64(gather(log_scales, rows, 3, 0))
    s1 = exp64(gather(log_scales, rows, 3, 1))
    s2 = exp64(gather(log_scales, rows, 3, 2))
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


@inlined
def coefficient_gradient(degree, values, coefficients, m, sh_set, products, weights):
    """Gradients by the coefficients of a set into products [(degree + 1)^2, 3, LANES64], and add what each basis
    function weighs in the colours' gradient to weights [(degree + 1)^2, LANES64]; a colour below zero has none."""
    red, green, blue = colour(degree, values, coefficients)
    place = (TO_COLOURS + 3 * sh_set) * LANES64
    red = select(red >= 0, load64(m, place), 0)
    green = select(green >= 0, load64(m, place + LANES64), 0)
    blue = select(blue >= 0, load64(m, place + 2 * LANES64), 0)
    for k in range((degree + 1) * (degree + 1)):
        value, at = load64(values, k * LANES64), 3 * k * LANES64
        weight = red * load64(coefficients, at) + green * load64(coefficients, at + LANES64)
        weight = weight + blue * load64(coefficients, at + 2 * LANES64)
        store64(load64(weights, k * LANES64) + weight, weights, k * LANES64)
        store64(value * red, products, at)
        store64(value * green, products, at + LANES64)
        store64(value * blue, products, at + 2 * LANES64)


@inlined
def write_gradients(i, columns, lane, stride, g_means, g_quaternions, g_log_scales, g_opacity_logits, g_2d, g_absolute):
    """The gradients of Gaussian i out of a lane of `columns`."""
    for k in range(3):
        g_means[i, k] = columns[(MEANS + k) * stride + lane]
        g_log_scales[i, k] = columns[(SCALES + k) * stride + lane]
    for k in range(4):
        g_quaternions[i, k] = columns[(QUATERNIONS + k) * stride + lane]
    g_opacity_logits[i] = columns[LOGIT * stride + lane]
    for k in range(2):
        g_2d[i, k] = columns[(MEANS2D + k) * stride + lane]
        g_absolute[i, k] = columns[(ABSOLUTE + k) * stride + lane]


@inlined
def finish(sh, row, size, used, gradients, start, form):
    """Write a row of the gradient by sh, whose last `size - used` numbers are zero, or take Adam's step with it.

    For the forms see `project_gradient`.
    """
    if len(form) == 1:
        for part in range(0, size - LANES + 1, LANES):
            store(load(gradients, start + part), form[0], row + part)
        for k in range(size // LANES * LANES, size):
            form[0][row + k] = gradients[start + k]
    else:
        first, second, rates, constants = form
        prefetch_row(first, row + NEXT * size, used)
        prefetch_row(second, row + NEXT * size, used)
        whole = min((used + LANES - 1) // LANES * LANES, size)
        move(sh, first, second, row, whole, gradients, start, rates, constants)


@exact_kernel
def project_gradient(
    means, quaternions, log_scales, opacity_logits, sh, degree, pose, centre, lens, width, height, antialiased,
    splats, gaussian, counts, pair_start, pair_end, moments,
    g_means, g_quaternions, g_log_scales, g_opacity_logits, g_means2d, g_means2d_absolute, form,
):  # fmt: skip
    """Gather each splat's moments from its tiles and carry them back through the projection.

    The gathering order is the Gaussian's own, so no atomics are needed and the sum is always the same. What the view
    does not show has a gradient of zero.

    Adam's step leaves coefficients above `degree` alone. That is exact as long as the degree only rises: their
    gradient has always been zero, and so are their moments.

    Args:
        means ... antialiased: what `project` was given, sh [L, N, K, 3] with L sets of coefficients.
        splats, gaussian, counts: what it wrote.
        pair_start, pair_end: int32 by slot [N]: the rows of `moments` of a splat's tiles.
        moments: [pairs, M] from `blend_gradient`, at least 8 + 3 L, a multiple of 16.
        g_...: output, as the parameters; g_means2d [N, 2] is by the position on the image, in pixels, and
            g_means2d_absolute [N, 2] the sum over pixels of its absolute value.
        form: (g_sh,), the gradient by sh, to be written, flat; or (first, second, rates, constants), for Adam to
            change sh and its moments, flat, in place: see `adam.settings`, rates are [3 K].
    """
    n, sets, row_size, used = means.shape[0], sh.shape[0], 3 * sh.shape[2], 3 * (degree + 1) * (degree + 1)
    size, moment_size = splats.shape[1], moments.shape[1]
    flat_means, flat_quaternions = means.reshape(-1), quaternions.reshape(-1)
    flat_scales, flat_sh = log_scales.reshape(-1), sh.reshape(-1)
    flat_splats, flat_moments = splats.reshape(-1), moments.reshape(-1)
    for chunk in prange(CHUNKS):
        start, stop = chunk * n // CHUNKS, (chunk + 1) * n // CHUNKS
        end = start + counts[chunk]
        own, slots, rows = np.arange(LANES64), np.empty(LANES64, np.int64), np.empty(LANES64, np.int64)
        sums, m = np.empty(moment_size * LANES64, np.float32), np.empty(moment_size * LANES64, np.float32)
        values = np.empty(MAX_COEFFICIENTS * LANES64, np.float32)
        coefficients = np.empty(MAX_ROW * LANES64, np.float32)
        weights = np.empty(MAX_COEFFICIENTS * LANES64, np.float32)
        products = np.zeros(MAX_ROW * LANES64, np.float32)
        g_sh = np.zeros(sets * LANES64 * MAX_ROW, np.float32)
        small = np.empty(GRADIENTS * LANES64, np.float32)
        none = np.zeros(MAX_ROW, np.float32)
        following = start  # the Gaussian after the last that is finished
        for at in range(start, end, LANES64):
            for lane in range(LANES64):
                slots[lane] = min(at + lane, end - 1)
                rows[lane] = gaussian[slots[lane]]
                prefetch_row(flat_sh, row_size * np.int64(gaussian[min(at + lane + AHEAD, end - 1)]), used)
            sum_moments(flat_moments, moment_size, pair_start, pair_end, slots, own, sums, m)
            l = (
                gather(flat_splats, slots, size, L11),
                gather(flat_splats, slots, size, L21),
                gather(flat_splats, slots, size, L22),
            )
            gx, gy, gz = shape_gradient(
                flat_means, flat_quaternions, flat_scales, rows, pose, lens, width, height, antialiased, l, m, small
            )
            opacity = sigmoid(gather(opacity_logits, rows, 1, 0))
            store64(to_float32(moment(m, W) * (1.0 - opacity)), small, LOGIT * LANES64)

            dx, dy, dz, inverse_distance = direction(flat_means, rows, centre)
            basis(degree, dx, dy, dz, values)
            weights[:] = 0
            for sh_set in range(sets):
                read_coefficients(flat_sh, rows, row_size, sh_set * n * row_size, used, coefficients)
                coefficient_gradient(degree, values, coefficients, m, sh_set, products, weights)
                for k in range(0, (used + LANES - 1) // LANES * LANES, LANES64):
                    transpose(
                        LANES64, products, own, LANES64, k * LANES64, g_sh, sh_set * LANES64 * MAX_ROW + k, MAX_ROW
                    )
            if degree > 0:
                hx, hy, hz = direction_gradient(degree, dx, dy, dz, weights)
                along = hx * dx + hy * dy + hz * dz
                gx = gx + to_float64(hx - along * dx) * inverse_distance
                gy = gy + to_float64(hy - along * dy) * inverse_distance
                gz = gz + to_float64(hz - along * dz) * inverse_distance
            store64(to_float32(gx), small, MEANS * LANES64)
            store64(to_float32(gy), small, (MEANS + 1) * LANES64)
            store64(to_float32(gz), small, (MEANS + 2) * LANES64)

            for lane in range(min(LANES64, end - at)):
                i = rows[lane]
                for hidden in range(following, i):
                    write_gradients(hidden, none, 0, 1, g_means, g_quaternions, g_log_scales, g_opacity_logits, g_means2d, g_means2d_absolute)
                    for sh_set in range(sets):
                        finish(flat_sh, (sh_set * n + hidden) * row_size, row_size, used, none, 0, form)
                write_gradients(i, small, lane, LANES64, g_means, g_quaternions, g_log_scales, g_opacity_logits, g_means2d, g_means2d_absolute)
                for sh_set in range(sets):
                    place = (sh_set * LANES64 + lane) * MAX_ROW
                    finish(flat_sh, (sh_set * n + i) * row_size, row_size, used, g_sh, place, form)
                following = i + 1
        for hidden in range(following, stop):
            write_gradients(hidden, none, 0, 1, g_means, g_quaternions, g_log_scales, g_opacity_logits, g_means2d, g_means2d_absolute)
            for sh_set in range(sets):
                finish(flat_sh, (sh_set * n + hidden) * row_size, row_size, used, none, 0, form)
