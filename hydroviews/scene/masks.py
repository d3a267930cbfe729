"""Masks of pixels that training and scoring ignore: people, number plates, a car's bonnet.

On disk masks follow COLMAP's convention: `masks/<image file name>.png`, so
`masks/frame-0001.png.png` for `images/frame-0001.png`; black (0) is hidden, anything else is shown. In memory
they are bool [H, W], True where hidden.
"""

import hashlib
import unicodedata
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from hydroviews.files.atomic import sha256, write_bytes
from hydroviews.scene.images import read_pixels

MASKS = "masks"
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
    """Read a mask file: bool [H, W], True where it is black.

    Raises:
        InputError: missing or unreadable.
    """
    return np.asarray(read_grey(path) == 0)


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
