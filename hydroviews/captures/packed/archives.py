"""Rendered captures as archives in the package, so that a first build need not render them.

An archive has the pixels of a capture that `embedded_scenes.captures.render_embedded` wrote, without loss. Unpacking
encodes them with this machine's libraries, as rendering would: the same files, byte by byte.

    cameras.json, points.npz    as rendered
    images/000.webp             lossless
    depth.xz                    all depth maps, see `depth_code`
"""

import hashlib
import io
import json
import logging
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
from numpy.typing import NDArray

from hydroviews.captures.packed.depth_code import decode, encode
from hydroviews.errors import InputError
from hydroviews.files.atomic import read_json, replacing, write_bytes, write_json
from hydroviews.scene.depth import stored_depth, write_depth
from hydroviews.scene.images import read_pixels, write_png

logger = logging.getLogger(__name__)

FOLDER = Path(__file__).parent
HASHES = "SHA256SUMS"  # of the archives, as `sha256sum --check` reads it
UNPACKED = "unpacked.json"  # in the folder of a capture: which archive it is from
LICENCE = "Apache-2.0"
RENDER = ", or render the capture: `make dataset RENDER=1`"
CAMERAS, REQUEST, POINTS, DEPTH = "cameras.json", "request.json", "points.npz", "depth.xz"
FIRST = (1980, 1, 1, 0, 0, 0)  # the time of every member: the same capture gives the same archive


def pack(capture: Path, archives: Path = FOLDER) -> Path:
    """Pack a finished rendered capture into `<archives>/<its folder's name>.zip`, and enter the archive's hash.

    Raises:
        InputError: a file of the capture is missing or unreadable.
    """
    names = [view["name"] for view in read_json(capture / CAMERAS)["views"]]
    target = archives / f"{capture.name}.zip"
    with replacing(target) as temporary, zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in (CAMERAS, POINTS):
            archive.writestr(zipfile.ZipInfo(name, FIRST), (capture / name).read_bytes(), zipfile.ZIP_DEFLATED)
        for name in names:
            pixels = read_pixels(_picture(capture, name))[..., ::-1]
            archive.writestr(zipfile.ZipInfo(f"images/{name}.webp", FIRST), _webp(pixels))
        depth = np.stack([stored_depth(_depth(capture, name)) for name in names])
        archive.writestr(zipfile.ZipInfo(DEPTH, FIRST), encode(depth))
    hashes = {**_hashes(archives), target.name: _sha256(target.read_bytes())}
    write_bytes(archives / HASHES, "".join(f"{value}  {name}\n" for name, value in sorted(hashes.items())).encode())
    return target


def unpack(capture: Path, version: int, archives: Path = FOLDER) -> bool:
    """Unpack the archive of the capture's folder name, if there is one that today's renderer would give.

    Files of an interrupted call or of an interrupted rendering are kept. `cameras.json` is written last.

    Args:
        capture: folder of the rendered capture, finished, begun or missing.
        version: of the renderer, which the archive has to have.
        archives: folder of the archives.

    Returns:
        True if the folder now holds the archive's capture, or the same one as rendered here.

    Raises:
        InputError: the archive is damaged, or the disk is full.
    """
    path = archives / f"{capture.name}.zip"
    if not path.is_file():
        return False
    content = read_checked(path)
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        cameras = json.loads(archive.read(CAMERAS))
        if cameras["request"]["version"] != version:
            return False
        _begin(capture, cameras["request"])
        names = [view["name"] for view in cameras["views"]]
        if not all(file.is_file() for file in _files(capture, names)):
            write_json(capture / UNPACKED, {"archive": path.name, "sha256": _sha256(content), "licence": LICENCE})
            _write_missing(capture, archive, cameras["views"])
            write_bytes(capture / CAMERAS, archive.read(CAMERAS))
            logger.info("%s: unpacked; RENDER=1 renders this capture instead", capture)
    return True


def forget_unpacked(capture: Path) -> None:
    """Let a capture that was unpacked be rendered: rendering starts over where these files are missing."""
    if (capture / UNPACKED).is_file():
        for name in (CAMERAS, REQUEST, UNPACKED):
            (capture / name).unlink(missing_ok=True)


def _files(capture: Path, names: list[str]) -> list[Path]:
    pictures = [file for name in names for file in (_picture(capture, name), _depth(capture, name))]
    return [*pictures, capture / POINTS, capture / CAMERAS]


def _picture(capture: Path, name: str) -> Path:
    return capture / "images" / f"{name}.png"


def _depth(capture: Path, name: str) -> Path:
    return capture / "depth" / f"{name}.exr"


def _begin(capture: Path, request: dict[str, Any]) -> None:
    """Take the folder for a request; what was rendered for another one goes, as when rendering starts over."""
    started = capture / REQUEST
    if started.is_file() and read_json(started) == request:
        return
    numbered = [*capture.glob("images/[0-9][0-9][0-9]*.png"), *capture.glob("depth/[0-9][0-9][0-9]*.exr")]
    for path in [capture / CAMERAS, capture / POINTS, *numbered]:
        path.unlink(missing_ok=True)
    write_json(started, request)


def _write_missing(capture: Path, archive: zipfile.ZipFile, views: list[dict[str, Any]]) -> None:
    if not (capture / POINTS).is_file():
        write_bytes(capture / POINTS, archive.read(POINTS))
    names = [view["name"] for view in views]
    for name in names:
        if not _picture(capture, name).is_file():
            with PIL.Image.open(io.BytesIO(archive.read(f"images/{name}.webp"))) as picture:
                write_png(_picture(capture, name), np.asarray(picture.convert("RGB")))
    if not all(_depth(capture, name).is_file() for name in names):
        shape = len(views), views[0]["height"], views[0]["width"]
        for name, depth in zip(names, decode(archive.read(DEPTH), shape), strict=True):
            write_depth(_depth(capture, name), depth)


def _webp(pixels: NDArray[np.uint8 | np.uint16]) -> bytes:
    encoded = io.BytesIO()
    PIL.Image.fromarray(np.ascontiguousarray(pixels)).save(encoded, "WEBP", lossless=True, quality=90, method=4)
    return encoded.getvalue()


def read_checked(path: Path) -> bytes:
    """The content of a file that ships here, whose hash is that in HASHES beside the file.

    Raises:
        InputError: the file is missing or damaged.
    """
    content = path.read_bytes() if path.is_file() else b""
    expected, found = _hashes(path.parent).get(path.name), _sha256(content)
    if found != expected:
        raise InputError(
            f"{path}: damaged" if content else f"{path}: missing",
            found=f"SHA-256 {found}",
            expected=f"{expected}, from {HASHES}",
            fix="install HydroViews again"
            + (", or render the capture: `make dataset RENDER=1`" * (path.suffix == ".zip")),
        )
    return content


def _hashes(archives: Path) -> dict[str, str]:
    path = archives / HASHES
    lines = path.read_text().splitlines() if path.is_file() else []
    return {name: value for value, name in (line.split(maxsplit=1) for line in lines)}


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
