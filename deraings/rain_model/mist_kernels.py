# Numba infers the types of kernels.
# mypy: allow-untyped-defs
"""A veil of lit water over a picture, mixed in linear light: R = encode((1 - V) decode(B) + V a).

That is how light adds up, and how thin mist lifts dark places far more than bright ones: V = 0.05 of white light turns
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
from hydroviews.scene.images import Image

BRIGHTEST = 4.0  # linear light, and square of the encoded value, up to which the tables go; brighter is clipped
STEPS = 2048
BANDS = 16  # rows are shared out in as many bands, whatever the number of threads
ONE, HALF, ZERO = np.float32(1), np.float32(0.5), np.float32(0)
SCALE = np.float32(STEPS / np.sqrt(BRIGHTEST))
LAST = np.float32(STEPS - 1e-2)


def _tables() -> tuple[NDArray[np.float32], ...]:
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
def _veiled(image, share, colour, decode, encode, out):
    """[H, W, 3] under a share V [H, W] of light `colour` [3]."""
    height, width = share.shape
    for row in prange(height):
        for i in range(width):
            v = share[row, i]
            for c in range(3):
                b = image[row, i, c]
                if v > ZERO:
                    b = look_up(encode, np.sqrt((ONE - v) * look_up(decode, b) + v * colour[c]))
                out[row, i, c] = b


@kernel
def _veiled_gradient(image, share, colour, decode, decode_slope, encode_slope, grad, g_image, g_share, g_colour):
    """Gradients by the image, the share [H, W] and, in sums [BANDS, 3], the colour."""
    height, width = share.shape
    for band in prange(BANDS):
        total = np.zeros(3, np.float32)
        for row in range(band * height // BANDS, (band + 1) * height // BANDS):
            for i in range(width):
                v, by_share = share[row, i], ZERO
                for c in range(3):
                    b, g = image[row, i, c], grad[row, i, c]
                    light = look_up(decode, b)
                    root = np.sqrt((ONE - v) * light + v * colour[c])
                    by_light = g * look_up(encode_slope, root)
                    by_share += by_light * (colour[c] - light)
                    total[c] += by_light * v
                    g_image[row, i, c] = by_light * (ONE - v) * look_up(decode_slope, b) if v > ZERO else g
                g_share[row, i] = by_share
        for c in range(3):
            g_colour[band, c] = total[c]


def warm_up() -> None:
    """Load the kernels; see `warm_up.compile_apart`."""
    compile_apart(f"from {__name__} import exercise_kernels; exercise_kernels()", [Path(__file__)])
    exercise_kernels()


def exercise_kernels() -> None:
    """Both kernels once, on a picture of one pixel."""
    pixel, share, buffers = np.zeros((1, 1, 3), np.float32), np.zeros((1, 1), np.float32), BufferPool()
    veiled(pixel, share, pixel[0, 0], buffers)
    veiled_gradient(pixel, share, pixel[0, 0], pixel, buffers)


def veiled(image: Image, share: NDArray[np.float32], colour: NDArray[np.float32], buffers: BufferPool) -> Image:
    """The picture behind a veil; where its share is nought, exactly the picture.

    Args:
        image: [H, W, 3], sRGB-encoded, not clipped above 1.
        share: V [H, W] in [0, 1], the part of the light that the veil replaces.
        colour: a [3], linear light of the veil.
        workspace: the result is one of its buffers.
    """
    out = buffers.array("veiled", image.shape)
    decode, _, encode, _ = TABLES
    _veiled(image, share, colour, decode, encode, out)
    return out


def veiled_gradient(
    image: Image,
    share: NDArray[np.float32],
    colour: NDArray[np.float32],
    gradient: Image,
    buffers: BufferPool,
) -> tuple[Image, NDArray[np.float32], NDArray[np.float32]]:
    """From the gradient by the veiled picture [H, W, 3] those by the picture, the share [H, W] and the colour [3]."""
    g_image = buffers.array("g_unveiled", image.shape)
    g_share = buffers.array("g_share", share.shape)
    g_colour = buffers.array("g_veil_colour", (BANDS, 3))
    decode, decode_slope, _, encode_slope = TABLES
    _veiled_gradient(image, share, colour, decode, decode_slope, encode_slope, gradient, g_image, g_share, g_colour)
    return g_image, g_share, g_colour.sum(axis=0)
