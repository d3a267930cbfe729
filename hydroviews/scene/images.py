"""Reading, writing and resizing pictures: float32 [H, W, 3], sRGB-encoded, [0, 1], unless a name says linear."""

from pathlib import Path

import cv2
import numpy as np
import PIL.Image
from numpy.typing import NDArray

from hydroviews.errors import InputError
from hydroviews.files.atomic import write_bytes

Image = NDArray[np.float32]

STREAK_WIDTH, STREAK_SIDE = 5, 480  # pixels: upright streaks are narrower, in a picture of this longer side

SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp")


def list_images(folder: Path) -> list[Path]:
    """The pictures directly in `folder`, sorted by name; hidden and partial files are left out."""
    return sorted(p for p in folder.iterdir() if p.suffix.lower() in SUFFIXES and not p.name.startswith("."))


def read_image(path: Path) -> Image:
    """Read 8- or 16-bit colour, grey or transparent (on black) pictures.

    Returns:
        float32 [H, W, 3], RGB, sRGB-encoded, [0, 1].

    Raises:
        InputError: the file is missing, or is not a picture.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such image", fix="check the folder, or remove the view from the cameras")
    encoded = np.fromfile(path, np.uint8)
    pixels = cv2.imdecode(encoded, cv2.IMREAD_UNCHANGED) if encoded.size else None
    if pixels is None:
        raise InputError(
            f"{path}: cannot be read as an image",
            found=f"{encoded.size} bytes",
            expected=f"one of {', '.join(SUFFIXES)}",
            fix="copy the file again; it may be cut short",
        )
    return _to_rgb(path, pixels)


def image_size(path: Path) -> tuple[int, int]:
    """Width and height in pixels of the picture that `read_image` gives, from the file's header where Pillow reads it.

    Raises:
        InputError: the file is missing, or is not a picture.
    """
    try:
        with PIL.Image.open(path) as picture:
            return picture.size
    except (OSError, PIL.Image.DecompressionBombError):
        pass  # read_image says what is wrong, or reads it all the same
    height, width = read_image(path).shape[:2]
    return width, height


def _to_rgb(path: Path, pixels: NDArray) -> Image:
    if pixels.dtype not in (np.uint8, np.uint16):
        raise InputError(f"{path}: unsupported pixel type", found=pixels.dtype, expected="8 or 16 bits a channel")
    image = pixels.astype(np.float32) / np.iinfo(pixels.dtype).max
    if image.ndim == 2:
        image = image[..., None]
    if image.shape[2] in (2, 4):  # premultiply: what is transparent is black
        image = image[..., :-1] * image[..., -1:]
    if image.shape[2] == 1:
        image = np.repeat(image, 3, axis=2)
    return np.ascontiguousarray(image[..., ::-1])


def to_uint8(image: NDArray) -> NDArray[np.uint8]:
    """Round [0, 1] to 0..255, clipping what lies outside."""
    return (np.clip(image, 0, 1) * 255 + 0.5).astype(np.uint8)


def write_png(path: Path, image: NDArray) -> None:
    """Write [H, W, 3], float in [0, 1] or uint8, as an 8-bit PNG; the same pixels give the same bytes."""
    pixels = image if image.dtype == np.uint8 else to_uint8(image)
    ok, encoded = cv2.imencode(".png", pixels[..., ::-1])
    if not ok:
        raise ValueError(f"{path}: PNG encoding failed for an array of shape {image.shape}")
    write_bytes(path, encoded.tobytes())


def resize_area(image: Image, width: int, height: int) -> Image:
    """Shrink by averaging the area each new pixel covers, in encoded values as other benchmarks do.

    Raises:
        ValueError: the new size is larger; enlarging invents detail.
    """
    old_height, old_width = image.shape[:2]
    if (width, height) == (old_width, old_height):
        return image
    if width > old_width or height > old_height:
        raise ValueError(f"cannot enlarge {old_width}x{old_height} to {width}x{height}")
    return np.asarray(cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA), np.float32)


def without_streaks(pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The picture without bright, upright, thin things, which are rain; for features and sharpness.

    An opening along rows, per channel, as wide as STREAK_WIDTH at a longer side of STREAK_SIDE.

    Args:
        pixels: uint8 [H, W] or [H, W, 3].
    """
    width = max(3, round(STREAK_WIDTH * max(pixels.shape[:2]) / STREAK_SIDE)) | 1  # odd, so that nothing is shifted
    opened = cv2.morphologyEx(pixels, cv2.MORPH_OPEN, np.ones((1, width), np.uint8))
    return np.asarray(opened, np.uint8)


def to_linear(image: NDArray) -> Image:
    """sRGB-encoded [0, 1] to linear light [0, 1] (IEC 61966-2-1)."""
    image = np.asarray(image, np.float32)
    return np.where(image <= 0.04045, image / 12.92, ((np.maximum(image, 0) + 0.055) / 1.055) ** 2.4).astype(np.float32)


def to_srgb(linear: NDArray) -> Image:
    """Linear light to sRGB-encoded [0, 1]; brighter than 1 is clipped (IEC 61966-2-1)."""
    x = np.clip(linear, 0, 1)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055).astype(np.float32)
