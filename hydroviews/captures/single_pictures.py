"""Pictures that are looked at one by one: upright, and with what their files say beside the colours."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hydroviews.captures.exif_orientation import TIFF
from hydroviews.scene.exif import AS_STORED, orientation
from hydroviews.scene.images import Image, read_pixels, to_image


class Picture(NamedTuple):
    """A picture as viewers show it, and what belongs to its pixels."""

    image: Image  # [H, W, 3], of what is transparent as well
    alpha: NDArray[np.uint8] | None  # opacity [H, W]; None where all is opaque
    bits: int  # a channel, in the file: 8 or 16


def read_upright(path: Path) -> Picture:
    """A picture turned as Exif says.

    Raises:
        InputError: see `read_pixels`.
    """
    pixels: NDArray = read_pixels(path)
    tag = AS_STORED if path.suffix.lower() in TIFF else orientation(path)  # OpenCV has turned TIFF files
    pixels = turned(pixels, tag)
    alpha = pixels[..., 3] if pixels.ndim == 3 and pixels.shape[2] == 4 else None
    if alpha is not None:
        alpha = (alpha // 257).astype(np.uint8) if alpha.dtype == np.uint16 else alpha
    colours = pixels if alpha is None else np.ascontiguousarray(pixels[..., :3])
    return Picture(to_image(colours), None if alpha is None or alpha.min() == 255 else alpha, 8 * pixels.itemsize)


def turned(pixels: NDArray, tag: int) -> NDArray:
    """Pixels [H, W, ...] as Exif's Orientation, 1 to 8, wants them shown."""
    if tag in (5, 6, 7, 8):
        pixels = pixels.swapaxes(0, 1)
    if tag in (2, 3, 6, 7):
        pixels = pixels[:, ::-1]
    if tag in (3, 4, 7, 8):
        pixels = pixels[::-1]
    return np.ascontiguousarray(pixels)
