"""Exif's Orientation: the tag of photographs whose pixels are stored as the sensor lay, not upright."""

import logging
from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np
import PIL.Image
import PIL.ImageOps
from numpy.typing import NDArray
from PIL.ExifTags import Base

from hydroviews.errors import InputError
from hydroviews.files.atomic import replacing, write_bytes
from hydroviews.formats.photographs import some
from hydroviews.scene.exif import AS_STORED, orientation
from hydroviews.scene.images import image_size, read_pixels

logger = logging.getLogger(__name__)

TIFF = (".tif", ".tiff")
DEEP = (".png", *TIFF)  # may have 16 bits a channel
QUALITY = 95  # of JPEG files after turning


def common_turn(paths: Iterable[Path]) -> bool:
    """Whether all photographs have to be turned, and in the same way.

    Photographs of several orientations stay as they are stored, and the log says so: drops on the lens then have
    the same place in all of them.

    Raises:
        InputError: TIFF files among such ones, which OpenCV and Pillow turn as they read them and COLMAP does not.
    """
    tags = {path: orientation(path) for path in paths}
    ways = set(tags.values())
    if len(ways) > 1:
        turned = [path for path, tag in tags.items() if tag != AS_STORED and path.suffix.lower() in TIFF]
        if turned:
            raise InputError(
                f"{turned[0].parent}: photographs of several orientations, TIFF files among those to be turned",
                found=f"{some([path.name for path in turned])} with an Orientation tag",
                fix="save them the way up that they are to have, without the tag",
            )
        logger.info("photographs held upright and sideways: all are left as they are stored, one way up is better")
    return len(ways) == 1 and AS_STORED not in ways


def write_upright(source: Path, target: Path) -> None:
    """Write a copy with its pixels turned upright, in the same format and with all other Exif tags.

    Colours of 16 bits a channel, which Pillow does not have, are written without tags.

    Raises:
        InputError: unreadable, or too large (see `scene.checks`).
    """
    image_size(source)
    pixels = read_pixels(source) if source.suffix.lower() in DEEP else None
    if pixels is not None and pixels.dtype == np.uint16 and pixels.ndim == 3:
        tag = AS_STORED if source.suffix.lower() in TIFF else orientation(source)  # OpenCV has turned TIFF files
        channels = [_turned(channel, tag) for channel in np.moveaxis(pixels, 2, 0)]
        write_bytes(target, cv2.imencode(target.suffix, np.dstack(channels))[1].tobytes())
        return
    with PIL.Image.open(source) as image:
        turned = PIL.ImageOps.exif_transpose(image)
        with replacing(target) as temporary, temporary.open("wb") as file:
            turned.save(file, image.format, quality=QUALITY, exif=turned.getexif())


def _turned(channel: NDArray[np.uint16], tag: int) -> NDArray[np.uint16]:
    image = PIL.Image.fromarray(channel)
    image.getexif()[Base.Orientation] = tag
    return np.asarray(PIL.ImageOps.exif_transpose(image))
