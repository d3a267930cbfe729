"""What Exif says of a photograph beside its pixels."""

from pathlib import Path

import PIL.Image
from PIL.ExifTags import Base

AS_STORED, TURNS = 1, range(2, 9)
ON_ITS_SIDE = range(5, 9)  # Orientations that exchange width and height


def orientation(path: Path) -> int:
    """Exif's Orientation from the file's header, 1 to 8: 1 is upright or no valid tag, 6 and 8 are portraits."""
    try:
        with PIL.Image.open(path) as image:
            tag = int(image.getexif().get(Base.Orientation, AS_STORED))
            return tag if tag in TURNS else AS_STORED
    except (OSError, ValueError, TypeError, PIL.Image.DecompressionBombError):
        return AS_STORED  # reading the pixels will raise what is wrong; a tag that is no number is none
