"""Photographs that were stored as the sensor lay, with a tag that says how to turn them (Exif's Orientation)."""

from collections.abc import Iterable
from pathlib import Path

import PIL.Image
import PIL.ImageOps
from PIL.ExifTags import Base

from hydroviews.files.atomic import replacing

AS_STORED, TURNS = 1, range(2, 9)
QUALITY = 95  # of JPEG files that are written anew


def orientation(path: Path) -> int:
    """Exif's Orientation, from the file's head: 1 is upright, 6 and 8 are portraits; 1 where nothing is said."""
    try:
        with PIL.Image.open(path) as image:
            said = int(image.getexif().get(Base.Orientation, AS_STORED))
            return said if said in TURNS else AS_STORED
    except OSError:  # whoever reads the pixels says what is wrong
        return AS_STORED


def common_turn(paths: Iterable[Path]) -> bool:
    """Whether all photographs are to be turned, and in the same way.

    Those that were held in several ways stay as they are stored, and a line says so: what is on the lens is then in
    the same place in all of them.
    """
    ways = {orientation(path) for path in paths}
    if len(ways) > 1:
        print("photographs held upright and sideways: all are left as they are stored, one way up is better")
    return len(ways) == 1 and AS_STORED not in ways


def write_upright(source: Path, target: Path) -> None:
    """A copy with its pixels turned upright, in the same format; all else that Exif says of it is kept."""
    with PIL.Image.open(source) as image:
        turned = PIL.ImageOps.exif_transpose(image)
        with replacing(target) as temporary, temporary.open("wb") as file:
            turned.save(file, image.format, quality=QUALITY, exif=turned.getexif())
