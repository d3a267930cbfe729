"""Masks of pixels that training and scoring ignore: people, number plates, a car's bonnet.

On disk masks follow COLMAP's convention: `masks/<image file name>.png`, so
`masks/frame-0001.png.png` for `images/frame-0001.png`; black is hidden. Greys are cut in the middle, transparent
pixels are hidden, and masks of two dark values, such as 0 and 1, show the brighter one. What other programs call their
masks `hydroviews.formats.mask_files` knows. In memory masks are bool [H, W], True where hidden.
"""

import hashlib
import unicodedata
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from hydroviews.files.atomic import sha256, write_bytes
from hydroviews.scene.images import image_size, read_pixels

MASKS = "masks"
MIDDLE = 128  # grey, of 255, below which a pixel is hidden
WHITE_HIDES = "dynamic_mask_"  # begins the names of instant-ngp's masks, in which white is hidden
TOUCHED = 1e-3  # share of hidden pixels in a resampled one from which it is hidden

Ignored = NDArray[np.bool_]  # [H, W], True where hidden


def mask_name(image: str) -> str:
    """COLMAP's name for the mask of an image file: `a/b.jpg` has `a/b.jpg.png`."""
    return image + ".png"


def find_mask(folder: Path, image: str) -> Path | None:
    """The mask of an image in a folder of masks, None where there is none.

    Args:
        folder: of the masks; it need not exist.
        image: file name relative to the folder of photographs. A mask of just that name counts as well if it is
            a PNG, as it does for COLMAP. Umlauts may be stored as letter and mark, as macOS does, in either name.
    """
    names = [mask_name(image), image] if image.lower().endswith(".png") else [mask_name(image)]
    spelt = dict.fromkeys(s for n in names for s in (n, *(unicodedata.normalize(form, n) for form in ("NFC", "NFD"))))
    return next((folder / name for name in spelt if (folder / name).is_file()), None)


def mask_digest(folder: Path) -> str:
    """Hexadecimal SHA-256 of the names and contents of all masks in a folder."""
    digest = hashlib.sha256()
    for path in sorted(folder.rglob("*.png")):
        digest.update(path.relative_to(folder).as_posix().encode() + bytes.fromhex(sha256(path)))
    return digest.hexdigest()


def read_grey(path: Path) -> NDArray[np.uint8]:
    """Read a picture as grey: the brightest channel of each pixel, uint8 [H, W]; alpha is ignored.

    Raises:
        InputError: missing, or not an 8- or 16-bit picture.
    """
    pixels: NDArray = read_pixels(path, "a mask")
    if pixels.ndim == 3:
        pixels = pixels[..., :3].max(axis=2) if pixels.shape[2] > 2 else pixels[..., 0]
    if pixels.dtype == np.uint16:
        pixels = np.ceil(pixels / 257)  # rounded up, so that only black becomes black
    return np.asarray(pixels, np.uint8)


def read_ignored(path: Path) -> Ignored:
    """Read a mask file: bool [H, W], True where it is black or transparent.

    Where alpha varies and the colours are not black and white, as in pictures that were cut out, alpha alone counts.
    White is hidden in instant-ngp's `dynamic_mask_...`.

    Raises:
        InputError: missing or unreadable.
    """
    grey, alpha = read_grey(path), read_alpha(path)
    black = _is_black(grey)
    hidden = ~black if path.name.lower().startswith(WHITE_HIDES) else black
    if alpha is None or alpha.min() == alpha.max():
        return hidden
    transparent = alpha < MIDDLE
    return transparent | hidden if np.isin(grey, (0, 255)).all() else transparent


def _is_black(grey: NDArray[np.uint8]) -> Ignored:
    """Darker than the middle; 0 where there are but two values, both dark."""
    values = np.unique(grey)
    two_dark = values[0] == 0 and len(values) <= 2 and values[-1] < MIDDLE
    return np.asarray(grey == 0 if two_dark else grey < MIDDLE)


def read_transparent(path: Path) -> Ignored:
    """What is transparent of a photograph: bool [H, W].

    Raises:
        InputError: see `read_pixels`.
    """
    alpha = read_alpha(path)
    return np.zeros(image_size(path)[::-1], np.bool_) if alpha is None else np.asarray(alpha < MIDDLE)


def read_alpha(path: Path) -> NDArray[np.uint8] | None:
    """The opacity of a picture's pixels, uint8 [H, W]; None where it has none.

    Raises:
        InputError: see `read_pixels`.
    """
    pixels: NDArray = read_pixels(path, "a mask")
    if pixels.ndim < 3 or pixels.shape[2] not in (2, 4):
        return None
    alpha = pixels[..., -1]
    return np.asarray(alpha // 257 if alpha.dtype == np.uint16 else alpha, np.uint8)


def write_ignored(path: Path, ignored: Ignored) -> None:
    """Write a mask file: black where hidden, white elsewhere; the same mask gives the same bytes."""
    ok, encoded = cv2.imencode(".png", np.where(ignored, np.uint8(0), np.uint8(255)))
    if not ok:
        raise ValueError(f"{path}: PNG encoding failed for an array of shape {ignored.shape}")
    write_bytes(path, encoded.tobytes())


def fit_ignored(ignored: Ignored, width: int, height: int) -> Ignored:
    """Resize a mask [H, W] to [height, width] of the same aspect; a pixel that a hidden one touches is hidden."""
    old_height, old_width = ignored.shape
    if (width, height) == (old_width, old_height):
        return ignored
    larger = width > old_width or height > old_height
    share = ignored.astype(np.float32)
    resized = cv2.resize(share, (width, height), interpolation=cv2.INTER_LINEAR if larger else cv2.INTER_AREA)
    return np.asarray(resized > TOUCHED)
