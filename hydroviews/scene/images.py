"""Reading, writing and resizing pictures: float32 [H, W, 3], sRGB-encoded, [0, 1], unless a name says linear."""

import logging
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import PIL.Image
from numpy.typing import NDArray

from hydroviews.errors import InputError
from hydroviews.files.atomic import write_bytes
from hydroviews.scene.checks import MAX_PIXELS, check_size
from hydroviews.scene.colour_profiles import in_srgb, profile_of
from hydroviews.scene.file_kinds import file_kind

logger = logging.getLogger(__name__)

PIL.Image.MAX_IMAGE_PIXELS = MAX_PIXELS  # one limit: Pillow's own is below the largest cameras, and warns first

Image = NDArray[np.float32]

STREAK_WIDTH, STREAK_SIDE = 5, 480  # pixels: upright streaks are narrower, in a picture of this longer side

LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)  # Rec. 709

PICTURE = "an image"  # what a file should be, unless it is a mask or a map

ROWS_AT_ONCE = 16  # of a picture: bounds the memory that large ones take

READ = ("JPEG", "PNG", "BMP", "WebP", "TIFF or raw")  # kinds by `file_kind`

SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp")


def list_images(folder: Path) -> list[Path]:
    """The pictures directly in `folder`, sorted by name; hidden and partial files are left out."""
    named = (path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES and not path.name.startswith("."))
    return sorted(path for path in named if not path.is_dir())


def read_image(path: Path) -> Image:
    """Read 8- or 16-bit colour, grey or transparent (on black) pictures.

    Returns:
        float32 [H, W, 3], RGB, sRGB-encoded, [0, 1].

    Raises:
        InputError: see `read_pixels`.
    """
    return to_image(read_pixels(path))


def read_pixels(path: Path, kind: str = PICTURE) -> NDArray[np.uint8 | np.uint16]:
    """Decode a picture, once its header says that it is not too large.

    Args:
        path: the file.
        kind: what it should be, for the error; colours of a picture with an ICC profile become sRGB.

    Returns:
        uint8 or uint16 [H, W], or [H, W, C] with channels in OpenCV's order.

    Raises:
        InputError: the file is missing, is not a picture of 8 or 16 bits, or is too large (see `scene.checks`).
    """
    image_size(path, kind)
    encoded = np.fromfile(path, np.uint8)
    try:
        pixels = cv2.imdecode(encoded, cv2.IMREAD_UNCHANGED)
    except cv2.error:
        pixels = None
    if pixels is None:
        raise _unreadable(path, kind)
    if pixels.dtype not in (np.uint8, np.uint16):
        raise InputError(f"{path}: unsupported pixel type", found=pixels.dtype, expected="8 or 16 bits a channel")
    profile = profile_of(path) if pixels.ndim == 3 and kind == PICTURE else None
    return np.asarray(pixels if profile is None else _in_srgb(path, pixels, profile))


def _in_srgb(path: Path, pixels: NDArray, profile: bytes) -> NDArray[np.uint8]:
    """Pixels [H, W, 3 or 4] in OpenCV's order, of a profile, as sRGB; at 8 bits."""
    if pixels.dtype == np.uint16:
        logger.info("%s: 16 bits a channel become 8, as its colour profile is converted to sRGB", path)
        pixels = (pixels / np.float32(257) + 0.5).astype(np.uint8)
    colours = in_srgb(pixels[..., 2::-1], profile)[..., ::-1]
    return np.asarray(np.concatenate([colours, pixels[..., 3:]], axis=2), np.uint8)


def image_size(path: Path, kind: str = "an image") -> tuple[int, int]:
    """Width and height in pixels from the picture's header: those of `read_image`.

    Args:
        path: the file.
        kind: what it should be, for the error.

    Raises:
        InputError: the file is missing, is not a picture, or is too large (see `scene.checks`).
    """
    if not path.is_file():
        raise InputError(f"{path}: no such image", fix="check the folder, or remove the view from the cameras")
    try:
        with PIL.Image.open(path) as picture:
            size = picture.size
    except PIL.Image.DecompressionBombError as error:
        raise InputError(f"{path}: too large", found=error, fix="make the photographs smaller") from None
    except OSError:
        raise _unreadable(path, kind) from None
    check_size(path, *size)
    return size


def _unreadable(path: Path, kind: str) -> InputError:
    is_really, size = file_kind(path), f"{path.stat().st_size} bytes"
    cut_short = not is_really or is_really in READ
    return InputError(
        f"{path}: cannot be read as {kind}",
        found=f"{size}, {is_really} by its content" if is_really else size,
        expected=f"one of {', '.join(SUFFIXES)}",
        fix="copy the file again; it may be cut short" if cut_short else "convert it to .png or .jpg, or take it away",
    )


def row_blocks(height: int) -> Iterator[slice]:
    """The rows of a picture, ROWS_AT_ONCE at a time."""
    return (slice(start, min(start + ROWS_AT_ONCE, height)) for start in range(0, height, ROWS_AT_ONCE))


def to_image(pixels: NDArray[np.uint8 | np.uint16]) -> Image:
    """What `read_pixels` gives as `read_image` has it."""
    image = np.empty((*pixels.shape[:2], 3), np.float32)
    for rows in row_blocks(len(pixels)):
        image[rows] = to_rgb(pixels[rows])
    return image


def to_rgb(pixels: NDArray[np.uint8 | np.uint16]) -> Image:
    """A few rows of what `read_pixels` gives as `read_image` has them: float32 [h, W, 3]."""
    image: NDArray = pixels if pixels.ndim == 3 else pixels[..., None]
    if image.shape[2] == 3:
        image = cv2.cvtColor(image, cv2.COLOR_BGR2RGB)
    elif image.shape[2] == 4:
        image = cv2.cvtColor(image, cv2.COLOR_BGRA2RGBA)
    if image.dtype == np.uint8:
        image = cv2.LUT(image, _ENCODED).reshape(image.shape)
    else:
        image = image.astype(np.float32) / np.iinfo(image.dtype).max
    if image.shape[2] in (2, 4):  # premultiply: what is transparent is black
        image = image[..., :-1] * image[..., -1:]
    return np.asarray(image if image.shape[2] == 3 else np.repeat(image, 3, axis=2))


_ENCODED = np.arange(256, dtype=np.float32) / 255


def to_uint8(image: NDArray) -> NDArray[np.uint8]:
    """Round [0, 1] to 0..255, clipping what lies outside."""
    return (np.clip(image, 0, 1) * 255 + 0.5).astype(np.uint8)


def write_png(path: Path, image: NDArray, alpha: NDArray[np.uint8] | None = None) -> None:
    """Write [H, W, 3], float in [0, 1] or uint8, as an 8-bit PNG; the same pixels give the same bytes.

    Args:
        path: of the file.
        image: the colours.
        alpha: opacity [H, W], where the picture has any.
    """
    pixels = image if image.dtype == np.uint8 else to_uint8(image)
    pixels = pixels[..., ::-1] if alpha is None else np.dstack([pixels[..., ::-1], alpha])
    ok, encoded = cv2.imencode(".png", pixels)
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


def luminance(linear: NDArray[np.float32]) -> NDArray[np.float32]:
    """Rec. 709 luminance [...] of linear light [..., 3]."""
    return linear @ LUMINANCE


def to_linear(image: NDArray) -> Image:
    """sRGB-encoded [0, 1] to linear light [0, 1] (IEC 61966-2-1)."""
    image = np.asarray(image, np.float32)
    linear = np.asarray(np.maximum(image, 0) + np.float32(0.055), np.float32)
    linear /= np.float32(1.055)
    np.power(linear, np.float32(2.4), out=linear)
    np.divide(image, np.float32(12.92), out=linear, where=image <= np.float32(0.04045))
    return linear


def to_srgb(linear: NDArray) -> Image:
    """Linear light to sRGB-encoded [0, 1]; brighter than 1 is clipped (IEC 61966-2-1)."""
    x = np.asarray(np.clip(linear, 0, 1))
    encoded = np.asarray(x ** (1 / 2.4))
    encoded *= 1.055
    encoded -= 0.055
    np.multiply(x, 12.92, out=encoded, where=x <= 0.0031308)
    return np.asarray(encoded, np.float32)
