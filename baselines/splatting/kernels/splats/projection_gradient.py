# Numba infers the types of kernels.
# mypy: allow-untyped-defs
"""The gradient of projection: from moments per splat back to every parameter of every Gaussian.

`project_gradient` is one kernel in two forms, which its last argument chooses when it is compiled: the gradient by the
spherical harmonics is written, or Adam takes its step with it at once. It is three quarters of all gradients, and
never has to go through memory that way. `shape_gradient.py` has the rest of the formulas.
"""

import numpy as np
from numba import prange

from baselines.splatting.kernels.adam import move
from baselines.splatting.kernels.chunks import CHUNKS
from baselines.splatting.kernels.jit import exact_kernel, inlined
from baselines.splatting.kernels.splats.geometry import sigmoid
from baselines.splatting.kernels.splats.projection import (
    AHEAD,
    L11,
    L21,
    L22,
    MAX_COEFFICIENTS,
    direction,
    prefetch_row,
    read_coefficients,
)
from baselines.splatting.kernels.splats.shape_gradient import (
    ABSOLUTE,
    GRADIENTS,
    LOGIT,
    MEANS,
    MEANS2D,
    QUATERNIONS,
    SCALES,
    TO_COLOURS,
    W,
    moment,
    shape_gradient,
)
from baselines.splatting.kernels.splats.spherical_harmonics import basis, colour, direction_gradient
from baselines.splatting.kernels.vector.memory import gather, load, load64, spread, store, store64, transpose
from baselines.splatting.kernels.vector.vectors import LANES, LANES64, select, to_float32, to_float64

NEXT = 8  # how many Gaussians ahead Adam's moments are asked for; past the end of an array that does nothing
MAX_ROW = 3 * MAX_COEFFICIENTS


@inlined
def sum_moments(moments, size, pair_start, pair_end, slots, own, sums, out):
    """The moments of LANES64 splats, each summed over its pairs, which may be none, into out [size, LANES64]."""
    for lane in range(LANES64):
        start, end = np.int64(pair_start[slots[lane]]), np.int64(pair_end[slots[lane]])
        for part in range(0, size, LANES):
            total = spread(np.float32(0))
            for pair in range(start, end):
                total = total + load(moments, pair * size + part)
            store(total, sums, lane * size + part)
    for column in range(0, size, LANES64):
        transpose(LANES64, sums, own, size, column, out, column * LANES64, LANES64)


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
def write_gradients(i, columns, lane, stride, outputs):
    """The gradients of Gaussian i out of a lane of `columns`."""
    g_means, g_quaternions, g_log_scales, g_opacity_logits, g_means2d, g_means2d_absolute = outputs
    for k in range(3):
        g_means[i, k] = columns[(MEANS + k) * stride + lane]
        g_log_scales[i, k] = columns[(SCALES + k) * stride + lane]
    for k in range(4):
        g_quaternions[i, k] = columns[(QUATERNIONS + k) * stride + lane]
    g_opacity_logits[i] = columns[LOGIT * stride + lane]
    for k in range(2):
        g_means2d[i, k] = columns[(MEANS2D + k) * stride + lane]
        g_means2d_absolute[i, k] = columns[(ABSOLUTE + k) * stride + lane]


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


@inlined
def leave_out(first, end, outputs, sh, sets, n, size, used, none, form):
    """Gradients of zero for the Gaussians from `first` to `end`."""
    for i in range(first, end):
        write_gradients(i, none, 0, 1, outputs)
        for sh_set in range(sets):
            finish(sh, (sh_set * n + i) * size, size, used, none, 0, form)


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
        outputs = g_means, g_quaternions, g_log_scales, g_opacity_logits, g_means2d, g_means2d_absolute
        following = start  # the Gaussian after the last that is finished
        for at in range(start, end, LANES64):
            for lane in range(LANES64):
                slots[lane] = min(at + lane, end - 1)
                rows[lane] = gaussian[slots[lane]]
                prefetch_row(flat_sh, row_size * np.int64(gaussian[min(at + lane + AHEAD, end - 1)]), used)
            sum_moments(flat_moments, moment_size, pair_start, pair_end, slots, own, sums, m)
            factor = (
                gather(flat_splats, slots, size, L11),
                gather(flat_splats, slots, size, L21),
                gather(flat_splats, slots, size, L22),
            )
            gx, gy, gz = shape_gradient(
                flat_means, flat_quaternions, flat_scales, rows, pose, lens, width, height, antialiased,
                factor, m, small,
            )  # fmt: skip
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
                leave_out(following, i, outputs, flat_sh, sets, n, row_size, used, none, form)
                write_gradients(i, small, lane, LANES64, outputs)
                for sh_set in range(sets):
                    place = (sh_set * LANES64 + lane) * MAX_ROW
                    finish(flat_sh, (sh_set * n + i) * row_size, row_size, used, g_sh, place, form)
                following = i + 1
        leave_out(following, stop, outputs, flat_sh, sets, n, row_size, used, none, form)
