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

from baselines.splatting.kernels.chunks import CHUNKS
from baselines.splatting.kernels.constants import CONIC_SCALE, FAR, LOG2_MIN_ALPHA, MIN_ALPHA
from baselines.splatting.kernels.jit import exact_kernel, inlined
from baselines.splatting.kernels.splats.geometry import (
    axes_on_screen,
    covariance,
    exp64,
    linearised,
    log2,
    rotation,
    sigmoid,
    to_camera,
    unit_quaternion,
)
from baselines.splatting.kernels.splats.spherical_harmonics import basis, colour
from baselines.splatting.kernels.vector.memory import gather, prefetch, store64, transpose
from baselines.splatting.kernels.vector.vectors import (
    LANES64,
    absolute,
    bits,
    lowest_bit,
    maximum,
    square_root,
    to_float32,
)

X, Y, L11, L21, L22, LOG2_OPACITY, CUTOFF, HALF_HEIGHT, HALF_WIDTH, COLOURS = range(10)

AHEAD = 16  # how many Gaussians ahead coefficients are asked for
LINE = 16  # floats in a line of the cache
MAX_COEFFICIENTS = 16
# No logit below this makes an opacity of 1/255; the exact test is made later.
LOWEST_LOGIT = math.log(MIN_ALPHA / (1 - MIN_ALPHA)) - 1e-3


@inlined
def candidates(means, opacity_logits, pose, near, first, end, out):
    """List in out[first:] the Gaussians from `first` to `end` that are in front and may be opaque enough; returns
    how many."""
    n = np.int64(0)
    for i in range(first, end):
        x, y, z = np.float64(means[i, 0]), np.float64(means[i, 1]), np.float64(means[i, 2])
        _, _, depth = to_camera(pose, x, y, z)
        out[first + n] = i
        # no branch, which would be taken as if by chance; false for NaN
        n += int((near < depth) & (depth < FAR) & (opacity_logits[i] > LOWEST_LOGIT))
    return n


@inlined
def read_shapes(means, quaternions, log_scales, rows):
    """Means, quaternions and scales of LANES64 Gaussians in float64."""
    return (
        (gather(means, rows, 3, 0), gather(means, rows, 3, 1), gather(means, rows, 3, 2)),
        (
            gather(quaternions, rows, 4, 0),
            gather(quaternions, rows, 4, 1),
            gather(quaternions, rows, 4, 2),
            gather(quaternions, rows, 4, 3),
        ),
        (
            exp64(gather(log_scales, rows, 3, 0)),
            exp64(gather(log_scales, rows, 3, 1)),
            exp64(gather(log_scales, rows, 3, 2)),
        ),
    )


@inlined
def outline(means, quaternions, log_scales, opacity_logits, rows, pose, lens, width, height, antialiased, columns):
    """Put position and shape of the splats of LANES64 Gaussians into `columns`, a row of LANES64 for each number.

    Returns:
        Their depths, and which are opaque, on the image and of finite shape.
    """
    mean, quaternion, s = read_shapes(means, quaternions, log_scales, rows)
    z, slope_x, slope_y, _, _, t = linearised(pose, lens, width, height, *mean)
    column, row = lens[0] * slope_x + lens[2], lens[1] * slope_y + lens[3]
    qw, qx, qy, qz, _ = unit_quaternion(*quaternion)
    a0, a1, a2, b0, b1, b2 = axes_on_screen(t, rotation(qw, qx, qy, qz), s)
    xx, xy, yy, determinant, sharp = covariance(a0, a1, a2, b0, b1, b2)
    opacity = sigmoid(gather(opacity_logits, rows, 1, 0))
    if antialiased:
        opacity = opacity * square_root(sharp / determinant)
    log2_opacity = log2(opacity)
    cutoff = log2_opacity - LOG2_MIN_ALPHA
    half_width, half_height = square_root(cutoff / CONIC_SCALE * xx), square_root(cutoff / CONIC_SCALE * yy)
    l11 = square_root(CONIC_SCALE * yy / determinant)
    store64(to_float32(column), columns, X * LANES64)
    store64(to_float32(row), columns, Y * LANES64)
    store64(to_float32(l11), columns, L11 * LANES64)
    store64(to_float32(-CONIC_SCALE * xy / (determinant * l11)), columns, L21 * LANES64)
    store64(to_float32(square_root(CONIC_SCALE / yy)), columns, L22 * LANES64)
    store64(to_float32(log2_opacity), columns, LOG2_OPACITY * LANES64)
    store64(to_float32(cutoff), columns, CUTOFF * LANES64)
    store64(to_float32(half_height), columns, HALF_HEIGHT * LANES64)
    store64(to_float32(half_width), columns, HALF_WIDTH * LANES64)
    shown = (opacity > MIN_ALPHA) & (l11 > 1e-30) & (l11 < 1e30)  # all false for NaN
    shown = shown & (column + half_width > 0) & (column - half_width < width)
    return z, shown & (row + half_height > 0) & (row - half_height < height)


@inlined
def direction(means, rows, centre):
    """Unit vectors from the camera to LANES64 Gaussians, float32, and one divided by the distance, float64."""
    x = gather(means, rows, 3, 0) - centre[0]
    y = gather(means, rows, 3, 1) - centre[1]
    z = gather(means, rows, 3, 2) - centre[2]
    inverse = 1.0 / square_root(x * x + y * y + z * z)
    return to_float32(x * inverse), to_float32(y * inverse), to_float32(z * inverse), inverse


@inlined
def prefetch_row(array, start, number):
    """Have `number` floats from `start` on brought into the cache."""
    for part in range(0, number, LINE):
        prefetch(array, start + part)


@inlined
def read_coefficients(sh, rows, row_size, offset, used, out):
    """The first `used` numbers of rows of sh, transposed into out [used, LANES64]; nothing else is read."""
    for column in range(0, used, LANES64):
        number = min(LANES64, used - column)
        transpose(number, sh, rows, row_size, offset + column, out, column * LANES64, LANES64)


@exact_kernel
def project(
    means, quaternions, log_scales, opacity_logits, sh, degree, pose, centre, lens, width, height, near, antialiased,
    splats, depths, gaussian, counts,
):  # fmt: skip
    """Fill the splats of what the view shows, a chunk of Gaussians after the other.

    Chunk c is the Gaussians from c N // CHUNKS to (c + 1) N // CHUNKS; its splats lie one after the other, in the
    order of Gaussians, from slot c N // CHUNKS on. Slots between are undefined.

    Culled: centre nearer than `near`, nowhere at least 1/255 opaque, wholly outside the image, or any parameter that
    leads to a number which is not finite.

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
        splats, depths: output by slot, float32 [N, 9 + 3 L] and [N].
        gaussian: output by slot, int32 [N]: whose splat it is.
        counts: output, int32 [CHUNKS]: how many splats a chunk has.
    """
    n, sets, row_size, used = means.shape[0], sh.shape[0], 3 * sh.shape[2], 3 * (degree + 1) * (degree + 1)
    size = splats.shape[1]
    flat_means, flat_quaternions = means.reshape(-1), quaternions.reshape(-1)
    flat_scales, flat_sh = log_scales.reshape(-1), sh.reshape(-1)
    for chunk in prange(CHUNKS):
        first = chunk * n // CHUNKS
        end = first + candidates(means, opacity_logits, pose, near, first, (chunk + 1) * n // CHUNKS, gaussian)
        rows = np.empty(LANES64, np.int64)
        columns = np.empty(size * LANES64, np.float32)
        values = np.empty(MAX_COEFFICIENTS * LANES64, np.float32)
        coefficients = np.empty(3 * MAX_COEFFICIENTS * LANES64, np.float32)
        depth = np.empty(LANES64, np.float32)
        slot = first
        for at in range(first, end, LANES64):
            for lane in range(LANES64):
                rows[lane] = gaussian[min(at + lane, end - 1)]
                prefetch_row(flat_sh, row_size * np.int64(gaussian[min(at + lane + AHEAD, end - 1)]), used)
            z, shown = outline(
                flat_means, flat_quaternions, flat_scales, opacity_logits, rows,
                pose, lens, width, height, antialiased, columns,
            )  # fmt: skip
            if bits(shown) == 0:
                continue
            store64(to_float32(z), depth, 0)
            dx, dy, dz, _ = direction(flat_means, rows, centre)
            basis(degree, dx, dy, dz, values)
            largest = absolute(dx) * 0
            for sh_set in range(sets):
                read_coefficients(flat_sh, rows, row_size, sh_set * n * row_size, used, coefficients)
                red, green, blue = colour(degree, values, coefficients)
                place = (COLOURS + 3 * sh_set) * LANES64
                store64(maximum(red, 0), columns, place)
                store64(maximum(green, 0), columns, place + LANES64)
                store64(maximum(blue, 0), columns, place + 2 * LANES64)
                largest = largest + absolute(red) + absolute(green) + absolute(blue)
            left = bits(shown & (largest < 1e30)) & ((1 << min(LANES64, end - at)) - 1)
            while left != 0:
                lane = lowest_bit(left)
                left &= left - 1
                for column in range(size):
                    splats[slot, column] = columns[column * LANES64 + lane]
                depths[slot], gaussian[slot] = depth[lane], rows[lane]
                slot += 1
        counts[chunk] = slot - first
