"""COLMAP's model files, binary and text (https://colmap.github.io/format.html), read with every length checked.

pycolmap reads them too, but takes a file cut short for a shorter model, or ends the process.
"""

import codecs
import struct
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hydroviews.errors import InputError
from hydroviews.files.atomic import as_file
from hydroviews.formats.geometry import rigid_pose
from hydroviews.scene.checks import check_colours, check_file_name, check_once, usable
from hydroviews.scene.lenses import Lens, named_lens
from hydroviews.scene.quaternions import rotation_entries
from hydroviews.scene.quiet_pycolmap import pycolmap

FORMS = (".bin", ".txt")


class RegisteredImage(NamedTuple):
    """An image of a model: its file name, its camera, its pose, and its keypoints as the file has them."""

    name: str
    camera_id: int
    world_to_camera: NDArray[np.float64]  # [4, 4]
    stored_keypoints: memoryview | str = ""

    def keypoints(self) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Pixels [K, 2] and ids [K] of the points that the image shows there; keypoints without a point are left out.

        Raises:
            ValueError: the text is not one of keypoints.
        """
        if isinstance(self.stored_keypoints, str):
            table = np.array(self.stored_keypoints.split(), np.float64).reshape(-1, 3)
            pixels, ids = table[:, :2], table[:, 2].astype(np.int64)
        else:
            records = np.frombuffer(self.stored_keypoints, [("pixel", "<f8", 2), ("id", "<i8")])
            pixels, ids = records["pixel"], records["id"]
        return pixels[ids >= 0], ids[ids >= 0]


@dataclass(frozen=True)
class SparsePoints:
    """Sparse points with their ids, reprojection errors in pixels and the number of views that see them."""

    positions: NDArray[np.float64]  # [N, 3]
    colours: NDArray[np.uint8]  # [N, 3]
    errors: NDArray[np.float64]  # [N]
    track_lengths: NDArray[np.int64]  # [N]
    ids: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))  # [N], ascending, where known


def model_suffix(folder: Path) -> str | None:
    """Either ".bin" or ".txt" where `folder` holds a model, else None."""
    for suffix in FORMS:
        if (folder / f"cameras{suffix}").is_file() and (folder / f"images{suffix}").is_file():
            return suffix
    return None


def read_cameras(folder: Path) -> dict[int, Lens]:
    """The cameras of the model in `folder` by their ids.

    Raises:
        InputError: damaged, cut short, of an unknown camera model, or against the rules of `scene.checks`.
    """
    path = folder / f"cameras{model_suffix(folder)}"
    cameras = []
    for number, model, width, height, params in _records(path, _binary_cameras, _text_cameras):
        cameras.append((number, named_lens(f"{path}: camera {number}", model, width, height, params)))
    check_once(path, "camera", [number for number, _ in cameras])
    return dict(cameras)


def read_images(folder: Path) -> list[RegisteredImage]:
    """The registered images of the model in `folder`.

    Raises:
        InputError: damaged, cut short, with a pose that is none, or against the rules of `scene.checks`.
    """
    path = folder / f"images{model_suffix(folder)}"
    images, ids = [], []
    for number, quaternion, translation, camera_id, name, keypoints in _records(path, _binary_images, _text_images):
        name = check_file_name(path, name.replace("\\", "/"))  # as programs on Windows write folders
        ids.append(number)
        pose = np.empty((3, 4))
        pose[:, :3], pose[:, 3] = _rotation(np.array(quaternion), f"{path}: {name}"), translation
        images.append(RegisteredImage(name, camera_id, rigid_pose(pose, f"{path}: {name}"), keypoints))
    check_once(path, "image", ids)
    return images


def read_points(folder: Path) -> SparsePoints:
    """The usable points of the model in `folder` in order of their ids; none where the file is missing.

    Raises:
        InputError: damaged, cut short, or against the rules of `scene.checks`.
    """
    path = folder / f"points3D{model_suffix(folder)}"
    rows = sorted(_records(path, _binary_points, _text_points)) if path.is_file() else []
    check_once(path, "point", [row[0] for row in rows])
    table = np.array(rows, np.float64).reshape(-1, 9)
    table = table[usable(path, table[:, 1:4])]
    colours = check_colours(path, table[:, 4:7])
    ids = np.minimum(table[:, 0], 2.0**62).astype(np.int64)
    return SparsePoints(table[:, 1:4], colours, table[:, 7], table[:, 8].astype(np.int64), ids)


def _rotation(quaternion: NDArray[np.float64], where: str) -> NDArray[np.float64]:
    """[3, 3] from a quaternion (w, x, y, z) of any length but zero."""
    length = np.linalg.norm(quaternion)
    if not (np.isfinite(length) and length > 0):
        raise InputError(f"{where}: the pose has numbers that are not finite, or no rotation", found=quaternion)
    return np.array(rotation_entries(*(quaternion / length))).reshape(3, 3)


def _records(path: Path, binary: Any, text: Any) -> Iterator[tuple]:
    """The records of a file by the parser of its format; damage raises InputError."""
    try:
        if path.suffix == ".bin":
            cursor = _Cursor(as_file(path).read_bytes())
            yield from binary(cursor)
            cursor.finish()
        else:
            yield from text(_decoded(as_file(path).read_bytes()).splitlines())
    except UnicodeDecodeError as error:
        raise InputError(
            f"{path}: a name that is not UTF-8",
            found=error.object[max(0, error.start - 20) : error.end + 20],
            fix="rename the photograph, and estimate the poses again",
        ) from error
    except (struct.error, ValueError, IndexError, OverflowError) as error:
        raise InputError(
            f"{path}: damaged or cut short",
            found=f"{path.stat().st_size} bytes ({error})",
            expected="a whole COLMAP model file",
            fix="copy the model again, or estimate the poses again",
        ) from error


def _decoded(content: bytes) -> str:
    """Text with or without a byte order mark; in UTF-16 where that says so, as PowerShell writes files."""
    return content.decode("utf-16" if content[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE) else "utf-8-sig")


class _Cursor:
    """Little-endian values from bytes, in order."""

    def __init__(self, content: bytes) -> None:
        self.content, self.offset = content, 0

    def take(self, layout: str) -> tuple:
        record = _record(layout)
        values = record.unpack_from(self.content, self.offset)
        self.offset += record.size
        return values

    def name(self) -> str:
        end = self.content.index(b"\0", self.offset)
        name = self.content[self.offset : end].decode()
        self.offset = end + 1
        return name

    def block(self, count: int) -> memoryview:
        self.offset += count
        return memoryview(self.content)[self.offset - count : self.offset]

    def skip(self, count: int) -> None:
        self.offset += count

    def finish(self) -> None:
        if self.offset != len(self.content):
            raise ValueError(f"the records end at byte {self.offset}")


@cache
def _record(layout: str) -> struct.Struct:
    return struct.Struct("<" + layout)


def _binary_cameras(cursor: _Cursor) -> Iterator[tuple]:
    for _ in range(cursor.take("Q")[0]):
        number, model_id, width, height = cursor.take("IiQQ")
        model = _model_name(model_id)
        count = len(pycolmap.Camera.create_from_model_name(1, model, 1.0, 1, 1).params)
        yield number, model, width, height, cursor.take(f"{count}d")


def _model_name(number: int) -> str:
    """COLMAP's name of a camera model.

    Raises:
        InputError: a number that pycolmap does not know.
    """
    names = {int(model): name for name, model in pycolmap.CameraModelId.__members__.items() if name != "INVALID"}
    if number not in names:
        raise InputError(
            f"camera model number {number}: unknown",
            expected=f"a model of COLMAP's: {', '.join(names.values())}",
            fix="undistort the photographs to PINHOLE in the program that wrote the model",
        )
    return names[number]


def _binary_images(cursor: _Cursor) -> Iterator[tuple]:
    for _ in range(cursor.take("Q")[0]):
        values = cursor.take("I7dI")
        name = cursor.name()
        keypoints = cursor.block(24 * cursor.take("Q")[0])
        yield values[0], values[1:5], values[5:8], values[8], name, keypoints


def _binary_points(cursor: _Cursor) -> Iterator[tuple]:
    for _ in range(cursor.take("Q")[0]):
        values = cursor.take("Q3d3BdQ")
        cursor.skip(8 * values[-1])  # track
        yield values


def _data_lines(lines: list[str]) -> Iterator[list[str]]:
    return (line.split() for line in lines if line.strip() and not line.startswith("#"))


def _text_cameras(lines: list[str]) -> Iterator[tuple]:
    for number, model, width, height, *params in _data_lines(lines):
        yield _whole(number), model, _whole(width), _whole(height), tuple(map(float, params))


def _text_images(lines: list[str]) -> Iterator[tuple]:
    """Two lines an image; one where people or editors left out the line of keypoints, such as an empty one."""
    rows = deque(line for line in lines if not line.startswith("#"))
    while rows:
        row = rows.popleft()
        if not row.strip():
            continue
        values = row.split(maxsplit=9)
        if len(values) != 10:
            raise ValueError(f"not an image: {row[:80]!r}")
        pose = tuple(map(float, values[1:8]))
        keypoints = rows.popleft().strip() if rows and not _is_image(rows[0]) else ""
        yield _whole(values[0]), pose[:4], pose[4:], _whole(values[8]), values[9].strip(), keypoints


def _is_image(row: str) -> bool:
    """Whether a line is an image's where keypoints are expected: ten words, of which the tenth is no number.

    Keypoints come in threes, so that a name of blanks and numbers alone is needed to be mistaken for them.
    """
    values = row.split(maxsplit=9)
    if len(values) != 10:
        return False
    return len(row.split()) % 3 != 0 or not all(map(_is_number, values[9].split()))


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _text_points(lines: list[str]) -> Iterator[tuple]:
    for values in _data_lines(lines):
        if len(values) < 8 or len(values) % 2:
            raise ValueError(f"not a point: {' '.join(values)[:80]!r}")
        yield _whole(values[0]), *map(float, values[1:8]), (len(values) - 8) // 2


def _whole(digits: str) -> int:
    number = int(digits)
    if abs(number) >= 2**64:
        raise ValueError(f"not a number of a COLMAP model: {digits[:80]}")
    return number
