"""Panoramas of 360 cameras: recognised, and cut into perspective photographs that cameras can be estimated for.

A panorama is equirectangular: twice as wide as high, all directions around, as its XMP says (Google's GPano) or as the
seam between its left and right ends shows.
"""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
import PIL.Image
from numpy.typing import NDArray
from PIL.ExifTags import IFD, Base
from tqdm import tqdm

from hydroviews.errors import InputError
from hydroviews.files.atomic import replacing
from hydroviews.formats.photographs import some
from hydroviews.scene.images import Image, image_size, read_image, to_uint8

Panoramas = Literal["cut", "refuse"]

DIRECTIONS = range(0, 360, 60)  # degrees around, of the photographs that a panorama becomes
FIELD_OF_VIEW = 90  # degrees of each: neighbours share a third
XMP_BYTES = 262_144  # from a file's beginning, in which XMP stands
PROJECTION = re.compile(rb"ProjectionType\s*(?:=\s*[\"']|>)\s*(\w+)")
EQUIRECTANGULAR = b"equirectangular"
SEAM = 2.0  # of a panorama's ends against its neighbouring columns, at most: how much more they differ
QUALITY = 95  # of the JPEG files
FULL_FRAME = 43.27  # millimetres of the diagonal that Exif's 35 mm focal lengths are of


def is_panorama(path: Path) -> bool:
    """Whether a photograph is equirectangular, by its XMP or, where that is silent, by its shape and its seam.

    Raises:
        InputError: unreadable; or XMP says that it is one, of another shape than twice as wide as high.
    """
    width, height = image_size(path)
    said = _projection(path)
    if said == EQUIRECTANGULAR and width != 2 * height:
        raise InputError(
            f"{path}: a part of a panorama",
            found=f"{width}x{height} pixels, {said.decode()} as its XMP says",
            expected="all directions around, twice as wide as high",
            fix="cut perspective pictures out of it",
        )
    return width == 2 * height and (said == EQUIRECTANGULAR or (not said and _is_closed(path)))


def _projection(path: Path) -> bytes:
    with path.open("rb") as file:
        found = PROJECTION.search(file.read(XMP_BYTES))
    return found[1].lower() if found else b""


def _is_closed(path: Path) -> bool:
    """Whether the left and the right end of a picture go on into each other, and its upper edge is one place."""
    with PIL.Image.open(path) as image:
        image.draft("RGB", (512, 256))
        small = np.asarray(image.convert("RGB").resize((512, 256), PIL.Image.Resampling.BOX), np.float32)
    steps = np.abs(np.diff(small, axis=1)).mean(axis=(0, 2))
    seam = float(np.abs(small[:, 0] - small[:, -1]).mean())
    contrast = float(small.std())
    return seam <= SEAM * float(np.median(steps)) + 1 and float(small[0].std(axis=0).mean()) < 0.25 * contrast


def refuse_panoramas(paths: Sequence[Path]) -> None:
    """Refuse photographs of which some are panoramas.

    Raises:
        InputError: some are.
    """
    found = [path for path in paths if is_panorama(path)]
    if found:
        raise InputError(
            f"{found[0].parent}: panoramas, which no perspective camera takes",
            found=f"{some([path.name for path in found])}, equirectangular",
            expected="perspective photographs",
            fix="leave `--panoramas refuse` out: perspective photographs are then cut out of them",
        )


def perspective_sources(paths: Sequence[Path], folder: Path) -> dict[Path, tuple[Path, float]]:
    """The perspective photographs that panoramas become in a folder: for each its panorama and direction in degrees.

    Raises:
        InputError: two panoramas have one name.
    """
    if len({path.stem for path in paths}) < len(paths):
        raise InputError(f"{paths[0].parent}: several panoramas share a name", fix="rename them")
    return {folder / f"{path.stem}_{angle:03d}.jpg": (path, angle) for path in paths for angle in DIRECTIONS}


def cut_panoramas(targets: Mapping[Path, tuple[Path, float]]) -> None:
    """Write the perspective photographs that `perspective_sources` names; those that are there stay.

    Raises:
        InputError: a panorama cannot be read.
    """
    missing: dict[Path, list[Path]] = {}
    for target, (path, _) in targets.items():
        if not target.is_file():
            missing.setdefault(path, []).append(target)
    for path, absent in tqdm(missing.items(), desc="panoramas", unit="picture", disable=not missing):
        panorama = read_image(path)
        for target in absent:
            _write(target, perspective(panorama, targets[target][1]))


def perspective(panorama: Image, angle: float) -> Image:
    """What a perspective camera with FIELD_OF_VIEW sees of a panorama, level, that many degrees to the right.

    Args:
        panorama: [H, 2 H, 3]; its middle is straight ahead.
        angle: in degrees.

    Returns:
        Square, of about the panorama's resolution.
    """
    height, width = panorama.shape[:2]
    size = max(2, width // 4)
    focal = size / 2 / np.tan(np.radians(FIELD_OF_VIEW) / 2)
    x, y = np.meshgrid((np.arange(size) + 0.5 - size / 2) / focal, (np.arange(size) + 0.5 - size / 2) / focal)
    longitude = np.arctan2(x, 1) + np.radians(angle)
    latitude = np.arctan2(-y, np.hypot(x, 1))
    columns = (longitude / (2 * np.pi) + 0.5) % 1 * width - 0.5
    rows = (0.5 - latitude / np.pi) * height - 0.5
    around: NDArray = np.concatenate([panorama[:, -1:], panorama, panorama[:, :1]], axis=1)
    maps = (columns + 1).astype(np.float32), rows.astype(np.float32)
    return np.asarray(cv2.remap(around, *maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), np.float32)


def _write(path: Path, picture: Image) -> None:
    """Write a JPEG whose Exif has the focal length, which estimates of cameras begin with."""
    exif = PIL.Image.Exif()
    exif[Base.Make], exif[Base.Model] = "HydroViews", f"panorama, {FIELD_OF_VIEW} degrees"
    share = 0.5 / np.tan(np.radians(FIELD_OF_VIEW) / 2) / np.sqrt(2)  # of the diagonal
    exif.get_ifd(IFD.Exif)[Base.FocalLengthIn35mmFilm] = round(share * FULL_FRAME)
    with replacing(path) as temporary:
        PIL.Image.fromarray(to_uint8(picture)).save(temporary, "JPEG", quality=QUALITY, subsampling=0, exif=exif)
