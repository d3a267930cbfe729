# Numba infers the types of kernels.
# mypy: allow-untyped-defs
"""Mist over a picture, mixed in linear light: T = encode((1 - mist_alpha) decode(R) + mist_alpha a).

That is how light adds up, and why thin mist lightens dark places far more than bright ones: 0.05 of white light turns
an encoded 0 into 0.25. The sRGB curve (IEC 61966-2-1) and its slope come from tables, the inverse over the square root
of light, where it is nearly straight; the largest error of an encoded value is below 1e-5.
"""

from pathlib import Path

import numpy as np
from numba import prange
from numpy.typing import NDArray

from baselines.splatting.backends.warm_up import compile_apart
from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.kernels.jit import inlined, kernel
from deraings.image_planes import Plane
from hydroviews.scene.images import Image

BRIGHTEST = 4.0  # linear light, and square of the encoded value, up to which the tables go; brighter is clipped
STEPS = 2048
BANDS = 16  # rows are shared out in as many bands, whatever the number of threads
ONE, HALF, ZERO = np.float32(1), np.float32(0.5), np.float32(0)
SCALE = np.float32(STEPS / np.sqrt(BRIGHTEST))
LAST = np.float32(STEPS - 1e-2)


def _tables() -> tuple[NDArray[np.float32], ...]:
    """sRGB as in `hydroviews.scene.images`, both ways with slopes, by the square root of the light."""
    x = np.linspace(0, np.sqrt(BRIGHTEST), STEPS + 1)
    light = x**2
    decode = np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4)
    decode_slope = np.where(x <= 0.04045, 1 / 12.92, 2.4 / 1.055 * ((x + 0.055) / 1.055) ** 1.4)
    dark = light <= 0.0031308
    safe = np.maximum(light, 0.0031308)
    encode = np.where(dark, 12.92 * light, 1.055 * safe ** (1 / 2.4) - 0.055)
    encode_slope = np.where(dark, 12.92, 1.055 / 2.4 * safe ** (1 / 2.4 - 1))
    tables = [t.astype(np.float32) for t in (decode, decode_slope, encode, encode_slope)]
    return tuple(tables)


TABLES = _tables()


@inlined
def look_up(table, x):
    """A table over [0, sqrt(BRIGHTEST)], straight between its entries."""
    place = min(max(x * SCALE, ZERO), LAST)
    index = int(place)
    part = place - np.float32(index)
    return table[index] + part * (table[index + 1] - table[index])


@kernel
def _add_mist(image, alpha, colour, decode, encode, out):
    """[H, W, 3] behind mist of alpha [H, W] and light `colour` [3]."""
    height, width = alpha.shape
    for row in prange(height):
        for i in range(width):
            v = alpha[row, i]
            for c in range(3):
                b = image[row, i, c]
                if v > ZERO:
                    b = look_up(encode, np.sqrt((ONE - v) * look_up(decode, b) + v * colour[c]))
                out[row, i, c] = b


@kernel
def _mist_gradient(image, alpha, colour, decode, decode_slope, encode_slope, grad, g_image, g_alpha, g_colour):
    """Gradients by the image, alpha [H, W] and, in sums [BANDS, 3], the colour."""
    height, width = alpha.shape
    for band in prange(BANDS):
        total = np.zeros(3, np.float32)
        for row in range(band * height // BANDS, (band + 1) * height // BANDS):
            for i in range(width):
                v, by_alpha = alpha[row, i], ZERO
                for c in range(3):
                    b, g = image[row, i, c], grad[row, i, c]
                    light = look_up(decode, b)
                    root = np.sqrt((ONE - v) * light + v * colour[c])
                    by_light = g * look_up(encode_slope, root)
                    by_alpha += by_light * (colour[c] - light)
                    total[c] += by_light * v
                    g_image[row, i, c] = by_light * (ONE - v) * look_up(decode_slope, b) if v > ZERO else g
                g_alpha[row, i] = by_alpha
        for c in range(3):
            g_colour[band, c] = total[c]


def warm_up() -> None:
    """Load the kernels; see `warm_up.compile_apart`."""
    compile_apart(f"from {__name__} import exercise_kernels; exercise_kernels()", [Path(__file__)])
    exercise_kernels()


def exercise_kernels() -> None:
    """Both kernels once, on a picture of one pixel."""
    pixel, alpha = np.zeros((1, 1, 3), np.float32), np.zeros((1, 1), np.float32)
    add_mist(pixel, alpha, pixel[0, 0], np.empty_like(pixel))
    mist_gradient(pixel, alpha, pixel[0, 0], pixel, BufferPool())


def add_mist(image: Image, alpha: Plane, colour: NDArray[np.float32], out: Image) -> Image:
    """The picture behind mist; where alpha is 0, exactly the picture.

    Args:
        image: [H, W, 3], sRGB-encoded, not clipped above 1.
        alpha: mist_alpha [H, W] in [0, 1].
        colour: a [3], linear light of the mist.
        out: [H, W, 3], filled and returned; not `image`.
    """
    decode, _, encode, _ = TABLES
    _add_mist(image, alpha, colour, decode, encode, out)
    return out


def mist_gradient(
    image: Image, alpha: Plane, colour: NDArray[np.float32], gradient: Image, buffers: BufferPool
) -> tuple[Image, Plane, NDArray[np.float32]]:
    """From the gradient by what `add_mist` returns: those by the picture [H, W, 3], alpha [H, W] and the colour [3].

    The first two are buffers.
    """
    g_image = buffers.array("g_behind_mist", image.shape)
    g_alpha = buffers.array("g_mist_alpha", alpha.shape)
    g_colour = buffers.array("g_mist_colour", (BANDS, 3))
    decode, decode_slope, _, encode_slope = TABLES
    _mist_gradient(image, alpha, colour, decode, decode_slope, encode_slope, gradient, g_image, g_alpha, g_colour)
    return g_image, g_alpha, g_colour.sum(axis=0)
