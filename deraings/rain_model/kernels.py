# Numba infers the types of kernels.
# mypy: allow-untyped-defs
"""Kernels of the rain model: the three layers, forward and back, and sums over pixels and views that they need.

Rain and drops mix encoded values, (1 - alpha) view + light. Mist mixes in linear light, as light adds up: thin mist
lightens dark places far more than bright ones, 0.05 of white light turns an encoded 0 into 0.25. The powers of the
sRGB curve (IEC 61966-2-1) are polynomials of square roots, which a processor calculates for many values at once; the
largest error of an encoded value is below 1e-5. So that it does, pictures behind mist are rows [H, 3 W] with the
channels interleaved, and what is the same for all of a pixel's channels is written out for each.
"""

from functools import cache
from pathlib import Path

import numpy as np
from numba import prange
from numpy.typing import NDArray

from baselines.splatting.backends.warm_up import compile_apart
from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.kernels.jit import inlined, kernel
from deraings.image_planes import Plane
from hydroviews.scene.images import Image

BRIGHTEST = np.float32(4)  # linear light that the curve goes up to; brighter is clipped
BRIGHTEST_ENCODED = np.float32(2)  # the same of encoded values
BANDS = 16  # rows are shared out in as many bands, whatever the number of threads
ONE, ZERO = np.float32(1), np.float32(0)
MIDDLE = np.float32(0.85)  # of the roots, about which both polynomials are taken
# ((x + 0.055) / 1.055)^2.4 = s^4.8 by powers of s - MIDDLE, s the square root of the bracket: Chebyshev fit, error 2e-7
DECODE = (
    *(0.45836448669433594, 2.5884101390838623, 5.78584623336792, 6.353111743927002),
    *(3.363612651824951, 0.6329753994941711, -0.025896815583109856, 0.005560650024563074),
)
# 1.055 light^(1 / 2.4) = 1.055 s^(5 / 3) by powers of s - MIDDLE, s the fourth root of the light: likewise, 3e-7
ENCODE = (
    *(0.8046692609786987, 1.5777807235717773, 0.6187214255332947, -0.08078789710998535, 0.0320766344666481),
    *(-0.01864399015903473, 0.008771845139563084, -0.0020408283453434706, 0.013686680234968662, -0.01741623505949974),
)
D0, D1, D2, D3, D4, D5, D6, D7 = (np.float32(value) for value in DECODE)
E0, E1, E2, E3, E4, E5, E6, E7, E8, E9 = (np.float32(value) for value in ENCODE)
OFFSET, SCALE, STEEP, POWER = np.float32(0.055), np.float32(1 / 1.055), np.float32(12.92), np.float32(2.4)
DARK, DARK_LIGHT = np.float32(0.04045), np.float32(0.0031308)  # up to which the curve is straight


SUMS = 9  # of each pixel of a lens, see `add_view`
PRODUCT, SQUARE, SEEN = 6, 7, 8  # of the sums, after photograph and render
THIRD, THREE = np.float32(1 / 3), np.float32(3)
LEAST = np.float32(1e-20)  # a sum of weights that is divided by; where it is 0 so are the other sums


@inlined
def mix(alpha, behind, light):
    """What is seen where the share alpha of `behind` is blocked and as much of `light` added; numbers or tensors."""
    return behind + alpha * (light - behind)


@kernel
def behind_rain(image, alpha, brightness, out):
    """A view [H, W, 3] behind rain of alpha [H, W] and encoded value `brightness`, into `out`."""
    height, width = alpha.shape
    for row in prange(height):
        a_row, behind, seen = alpha[row], image[row], out[row]
        for i in range(width):
            for c in range(3):
                seen[i, c] = mix(a_row[i], behind[i, c], brightness)


@kernel
def behind_drops(image, alpha, around, light, out):
    """A view [H, W, 3] behind drops of alpha [H, W] into `out`.

    Drops show alpha times what is `around`, and L more, `light`, [H, W, 3] each.
    """
    height, width = alpha.shape
    for row in prange(height):
        a_row, behind, seen, shining, added = alpha[row], image[row], out[row], around[row], light[row]
        for i in range(width):
            for c in range(3):
                seen[i, c] = mix(a_row[i], behind[i, c], shining[i, c]) + added[i, c]


@kernel
def shade(gradient, alpha, out):
    """The gradient by what is behind, [H, W, 3] into `out`, from that by what is seen: 1 - alpha times it."""
    height, width = alpha.shape
    for row in prange(height):
        a_row, given, left = alpha[row], gradient[row], out[row]
        for i in range(width):
            share = ONE - a_row[i]
            for c in range(3):
                left[i, c] = share * given[i, c]


@inlined
def decode(value):
    """Linear light of an encoded value."""
    x = min(max(value, ZERO), BRIGHTEST_ENCODED)
    s = np.sqrt((x + OFFSET) * SCALE) - MIDDLE
    light = D0 + s * (D1 + s * (D2 + s * (D3 + s * (D4 + s * (D5 + s * (D6 + s * D7))))))
    return light if x > DARK else x * (ONE / STEEP)


@inlined
def encode(light):
    """The encoded value of linear light."""
    x = min(max(light, ZERO), BRIGHTEST)
    s = np.sqrt(np.sqrt(x)) - MIDDLE
    low = E0 + s * (E1 + s * (E2 + s * (E3 + s * E4)))
    high = E5 + s * (E6 + s * (E7 + s * (E8 + s * E9)))
    power = low + s * s * s * s * s * high
    return power - OFFSET if x > DARK_LIGHT else x * STEEP


@inlined
def spread_tint(colour, tint):
    """A light `colour` [3] for every value of a row [3 W]."""
    for i in range(tint.shape[0] // 3):
        tint[3 * i], tint[3 * i + 1], tint[3 * i + 2] = colour[0], colour[1], colour[2]


@inlined
def spread_alpha(alpha, share):
    """A row's alpha [W] for every value of it [3 W]."""
    for i in range(alpha.shape[0]):
        share[3 * i] = share[3 * i + 1] = share[3 * i + 2] = alpha[i]


@kernel
def _add_mist(image, alpha, colour, out):
    """Rows [H, 3 W] behind mist of alpha [H, W] and light `colour` [3]."""
    height, n = image.shape
    for band in prange(BANDS):
        tint, share = np.empty(n, np.float32), np.empty(n, np.float32)
        spread_tint(colour, tint)
        for row in range(band * height // BANDS, (band + 1) * height // BANDS):
            spread_alpha(alpha[row], share)
            behind, seen = image[row], out[row]
            for i in range(n):
                v, b = share[i], behind[i]
                misted = encode(mix(v, decode(b), tint[i]))
                seen[i] = misted if v > ZERO else b


@kernel
def _mist_gradient(image, misted, alpha, colour, grad, told, g_image, g_alpha, g_colour):
    """Gradients by the image's rows [H, 3 W], of `grad`; by alpha [H, W] and the colour, sums [BANDS, 3], of `told`."""
    height, n = image.shape
    for band in prange(BANDS):
        tint, share, by_alpha, by_tint = (
            np.empty(n, np.float32),
            np.empty(n, np.float32),
            np.empty(n, np.float32),
            np.zeros(n, np.float32),
        )
        spread_tint(colour, tint)
        for row in range(band * height // BANDS, (band + 1) * height // BANDS):
            spread_alpha(alpha[row], share)
            behind, seen, g_row, t_row, out = image[row], misted[row], grad[row], told[row], g_image[row]
            for i in range(n):
                v, b, t = share[i], behind[i], seen[i]
                light = decode(b)
                mixed = max(mix(v, light, tint[i]), DARK_LIGHT)
                encoding = (t + OFFSET) / (POWER * mixed) if t > DARK else STEEP
                by_light = t_row[i] * encoding
                by_alpha[i] = by_light * (tint[i] - light)
                by_tint[i] += by_light * v
                decoding = POWER * light / (b + OFFSET) if b > DARK else ONE / STEEP
                out[i] = g_row[i] * encoding * (ONE - v) * decoding if v > ZERO else g_row[i]
            a_row = g_alpha[row]
            for i in range(n // 3):
                a_row[i] = by_alpha[3 * i] + by_alpha[3 * i + 1] + by_alpha[3 * i + 2]
        for c in range(3):
            g_colour[band, c] = by_tint[c::3].sum()


@inlined
def split_differences(row, less, planes):
    """What two rows of pixels [w, 3] differ by, as planes [3, w]."""
    red, green, blue = planes[0], planes[1], planes[2]
    for i in range(row.shape[0]):
        red[i], green[i], blue[i] = row[i, 0] - less[i, 0], row[i, 1] - less[i, 1], row[i, 2] - less[i, 2]


@inlined
def remember(keep, weight, values, sums):
    """Sums [w] become keep sums + weight values."""
    for i in range(sums.shape[0]):
        sums[i] = keep[i] * sums[i] + weight[i] * values[i]


@inlined
def mean_product(a, b, out):
    """Mean over the channels of the product of two rows in planes [3, w]."""
    a0, a1, a2, b0, b1, b2 = a[0], a[1], a[2], b[0], b[1], b[2]
    for i in range(out.shape[0]):
        out[i] = THIRD * (a0[i] * b0[i] + a1[i] * b1[i] + a2[i] * b2[i])


@kernel
def add_view(photograph, seen, around, shown, keep, weight, sums):
    """Where shown [h, w], sums [h, 9, w] become keep sums + weight times those of one view, [h, w, 3] each.

    The nine sums of a pixel are photograph and render, three channels each, both less the light around the pixel,
    means over channels of their product and of the render's square, and the weights of the views that showed it. A
    row's sums lie together, one after another, and a loop does one thing to a few of them, so that a processor does it
    to many pixels at once.
    """
    height, width = sums.shape[0], sums.shape[2]
    for band in prange(BANDS):
        pixels, keeps, weights = (
            np.empty((SUMS, width), np.float32),
            np.empty(width, np.float32),
            np.empty(width, np.float32),
        )
        pixels[SEEN] = ONE
        for row in range(band * height // BANDS, (band + 1) * height // BANDS):
            split_differences(photograph[row], around[row], pixels[:3])
            split_differences(seen[row], around[row], pixels[3:6])
            mean_product(pixels[:3], pixels[3:6], pixels[PRODUCT])
            mean_product(pixels[3:6], pixels[3:6], pixels[SQUARE])
            shown_row = shown[row]
            for i in range(width):
                keeps[i] = keep if shown_row[i] else ONE
                weights[i] = weight if shown_row[i] else ZERO
            for k in range(SUMS):
                remember(keeps, weights, pixels[k], sums[row, k])


@inlined
def add_time(weight, values, total):
    """Adds values [w], times a weight, to a total [w]."""
    for i in range(values.shape[0]):
        total[i] += weight * values[i]


@inlined
def average_times(sums, stays, weights, row, mean, surely):
    """A row's means [9, w], sums over what is known, and `stays` [w], at the times weighed by weights [T]."""
    mean[:], surely[:] = ZERO, ZERO
    for time in range(sums.shape[0]):
        if weights[time] > ZERO:
            add_time(weights[time], stays[time, row], surely)
            for k in range(SUMS):
                add_time(weights[time], sums[time, row, k], mean[k])
    seen, share = mean[SEEN], mean[SUMS]
    for i in range(seen.shape[0]):
        share[i] = ONE / max(seen[i], LEAST)
    for k in range(SEEN):
        out = mean[k]
        for i in range(seen.shape[0]):
            out[i] *= share[i]


@inlined
def add_light(mean, alpha, light):
    """L [w, 3] of a row from its means [9, w] and alpha [w], before `leave_clear` bounds it."""
    p0, p1, p2, r0, r1, r2 = mean[0], mean[1], mean[2], mean[3], mean[4], mean[5]
    for i in range(alpha.shape[0]):
        left = ONE - alpha[i]
        light[i, 0], light[i, 1], light[i, 2] = p0[i] - left * r0[i], p1[i] - left * r1[i], p2[i] - left * r2[i]


@inlined
def leave_clear(clear, wet, alpha, light):
    """A row's alpha [w], times a smooth rise from 0 where it is `clear` to 1 where it is `wet`; L [w, 3] within it."""
    for i in range(alpha.shape[0]):
        rise = min(max((alpha[i] - clear) / (wet - clear), ZERO), ONE)
        m = alpha[i] * (rise * rise * (THREE - (rise + rise)))
        alpha[i] = m
        for c in range(3):
            light[i, c] = min(max(light[i, c], -m), m)


@kernel
def fit_lines(sums, weights, stays, noise, clear, wet, alpha, light):
    """Fills alpha [h, w] and light L [h, w, 3] from sums [T, h, 9, w], those of the times weighed by weights [T].

    alpha is what the slope lacks to one, times the probability `stays` [T, h, w]; up to `clear` it is taken for 0,
    from `wet` on for what it is. Both are 0 where no view was shown.
    """
    height, width = sums.shape[1], sums.shape[3]
    for band in prange(BANDS):
        mean, products = np.empty((SUMS + 1, width), np.float32), np.empty((2, width), np.float32)
        surely = np.empty(width, np.float32)
        for row in range(band * height // BANDS, (band + 1) * height // BANDS):
            average_times(sums, stays, weights, row, mean, surely)
            mean_product(mean[:3], mean[3:6], products[0])
            mean_product(mean[3:6], mean[3:6], products[1])
            together, alone, seen, a_row = products[0], products[1], mean[SEEN], alpha[row]
            product, square = mean[PRODUCT], mean[SQUARE]
            for i in range(width):
                covariance, variance = product[i] - together[i], max(square[i] - alone[i], ZERO)
                lost = ONE - (covariance + noise * noise) / (variance + noise * noise)
                m = min(max(lost, ZERO), ONE) * surely[i]
                a_row[i] = m if seen[i] > ZERO else ZERO
            add_light(mean, a_row, light[row])
            leave_clear(clear, wet, a_row, light[row])


@cache
def warm_up() -> None:
    """Load all kernels before a training's clock runs, once a process; see `compile_apart`."""
    compile_apart("rain", f"from {__name__} import exercise_kernels; exercise_kernels()", [Path(__file__)])
    exercise_kernels()


def exercise_kernels() -> None:
    """All kernels once, on pictures and lenses of one pixel."""
    pixel, plane = np.zeros((1, 1, 3), np.float32), np.zeros((1, 1), np.float32)
    sums, shown = np.zeros((1, 1, SUMS, 1), np.float32), np.ones((1, 1), np.bool_)
    behind_rain(pixel, plane, ONE, np.empty_like(pixel))
    add_mist(pixel, plane, pixel[0, 0], np.empty_like(pixel))
    mist_gradient(pixel, pixel, plane, pixel[0, 0], pixel, pixel, BufferPool())
    behind_drops(pixel, plane, pixel, pixel, np.empty_like(pixel))
    shade(pixel, plane, np.empty_like(pixel))
    add_view(pixel, pixel, pixel, shown, ONE, ONE, sums[0])
    fit_lines(sums, np.ones(1, np.float32), plane[None].copy(), ONE, ZERO, ONE, plane, pixel)


def add_mist(image: Image, alpha: Plane, colour: NDArray[np.float32], out: Image) -> Image:
    """The picture behind mist; where alpha is 0, exactly the picture.

    Args:
        image: [H, W, 3], sRGB-encoded, not clipped above 1.
        alpha: mist_alpha [H, W] in [0, 1].
        colour: a [3], linear light of the mist.
        out: [H, W, 3], filled and returned; not `image`.
    """
    _add_mist(_rows(image), alpha, colour, _rows(out))
    return out


def mist_gradient(
    image: Image,
    misted: Image,
    alpha: Plane,
    colour: NDArray[np.float32],
    gradient: Image,
    told: Image,
    buffers: BufferPool,
) -> tuple[Image, Plane, NDArray[np.float32]]:
    """From gradients by what `add_mist` returns: those by the picture [H, W, 3], alpha [H, W] and the colour [3].

    The first two are buffers.

    Args:
        image: as given to `add_mist`, and so are alpha and the colour.
        misted: what it returned.
        alpha: mist_alpha [H, W].
        colour: linear light [3].
        gradient: [H, W, 3], of the loss that the picture learns from.
        told: [H, W, 3], of the one that alpha and the colour learn from.
        buffers: to reuse.
    """
    g_image = buffers.array("g_behind_mist", image.shape)
    g_alpha = buffers.array("g_mist_alpha", alpha.shape)
    g_colour = buffers.array("g_mist_colour", (BANDS, 3))
    given = _rows(image), _rows(misted), alpha, colour, _rows(gradient), _rows(told)
    _mist_gradient(*given, _rows(g_image), g_alpha, g_colour)
    return g_image, g_alpha, g_colour.sum(axis=0)


def _rows(image: Image) -> NDArray[np.float32]:
    """A picture [H, W, 3] as rows [H, 3 W], channels interleaved; a view of it where it is contiguous."""
    return image.reshape(image.shape[0], -1)
