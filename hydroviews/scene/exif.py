"""What Exif says of a photograph beside its pixels."""

import struct
from pathlib import Path

import PIL.Image
from PIL.ExifTags import IFD, Base

IDENTITY = (
    *(Base.Make, Base.Model, Base.LensMake, Base.LensModel),
    *(Base.FocalLength, Base.FocalLengthIn35mmFilm, Base.DigitalZoomRatio),
)
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


def lens_identity(path: Path) -> tuple[str, ...]:
    """What tells one lens at one zoom from another: maker, model, lens and focal lengths; empty texts where not said.

    A telephone has several lenses behind photographs of one size, and a zoom has a camera for each focal length.
    """
    try:
        with PIL.Image.open(path) as image:
            exif = image.getexif()
            tags = {**exif, **exif.get_ifd(IFD.Exif)}
    except (OSError, ValueError, TypeError, SyntaxError, struct.error, PIL.Image.DecompressionBombError):
        return ("",) * len(IDENTITY)  # reading the pixels will raise what is wrong
    return tuple(_text(tags.get(tag, "")) for tag in IDENTITY)


def _text(value: object) -> str:
    """A tag's value; numbers to a hundredth, so that fractions of the same length are one."""
    try:
        return f"{float(value):.2f}"  # type: ignore[arg-type]
    except (TypeError, ValueError, ZeroDivisionError):
        return str(value).strip("\0 ")
