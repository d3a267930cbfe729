# Numba infers the types of kernels.
# mypy: allow-untyped-defs
"""Mist over a picture, mixed in linear light: T = encode((1 - mist_alpha) decode(R) + mist_alpha a).

That is how light adds up, and why thin mist lightens dark places far more than bright ones: 0.05 of white light turns
an encoded 0 into 0.25. The powers of the sRGB curve (IEC 61966-2-1) are polynomials of square roots, which a processor
calculates for many values at once; the largest error of an encoded value is below 1e-5. So that it does, pictures are
rows [H, 3 W] with the channels interleaved, and what is the same for all of a pixel's channels is written out for each.
"""

import numpy as np
from numba import prange
from numpy.typing import NDArray

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
                misted = encode((ONE - v) * decode(b) + v * tint[i])
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
                mixed = max((ONE - v) * light + v * tint[i], DARK_LIGHT)
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


def exercise_kernels() -> None:
    """Both kernels once, on a picture of one pixel."""
    pixel, alpha = np.zeros((1, 1, 3), np.float32), np.zeros((1, 1), np.float32)
    add_mist(pixel, alpha, pixel[0, 0], np.empty_like(pixel))
    mist_gradient(pixel, pixel, alpha, pixel[0, 0], pixel, pixel, BufferPool())


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
