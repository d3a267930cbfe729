"""ICC profiles of photographs: their colours as sRGB has them."""

import io
import logging
from functools import lru_cache
from pathlib import Path

import numpy as np
import PIL.Image
from numpy.typing import NDArray
from PIL import ImageCms

logger = logging.getLogger(__name__)

SAME = 2  # of 255, by which colours of a profile may differ from sRGB's that is taken for it
STEPS = np.linspace(0, 255, 6).astype(np.uint8)


def profile_of(path: Path) -> bytes | None:
    """The ICC profile that a picture's file says it is in, if that is one of RGB colours other than sRGB."""
    try:
        with PIL.Image.open(path) as picture:
            profile = picture.info.get("icc_profile")
    except (OSError, ValueError, SyntaxError, PIL.Image.DecompressionBombError):
        return None  # reading the pixels will raise what is wrong
    return profile if profile and _to_srgb(bytes(profile)) is not None else None


def in_srgb(pixels: NDArray[np.uint8], profile: bytes) -> NDArray[np.uint8]:
    """Colours [H, W, 3], RGB, of a profile as sRGB."""
    transform = _to_srgb(profile)
    if transform is None:
        return pixels
    return np.asarray(ImageCms.applyTransform(PIL.Image.fromarray(np.ascontiguousarray(pixels)), transform))


@lru_cache(maxsize=8)
def _to_srgb(profile: bytes) -> ImageCms.ImageCmsTransform | None:
    """The way from a profile to sRGB; None where it is sRGB, is damaged, or has no RGB colours."""
    try:
        opened = ImageCms.ImageCmsProfile(io.BytesIO(profile))
        if opened.profile.xcolor_space.strip() != "RGB":
            return None
        intent = ImageCms.Intent.RELATIVE_COLORIMETRIC
        transform = ImageCms.buildTransform(opened, ImageCms.createProfile("sRGB"), "RGB", "RGB", intent)
    except (ImageCms.PyCMSError, OSError, TypeError, ValueError, AttributeError) as error:
        logger.warning("a colour profile that cannot be read, so that sRGB is taken: %s", error)
        return None
    cube = np.stack(np.meshgrid(STEPS, STEPS, STEPS, indexing="ij"), axis=-1).reshape(1, -1, 3)
    as_srgb = np.asarray(ImageCms.applyTransform(PIL.Image.fromarray(cube), transform))
    return None if np.abs(as_srgb.astype(int) - cube).max() <= SAME else transform
