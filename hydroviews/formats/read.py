"""Read a capture as a scene, whichever of the known formats it has."""

import logging
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from hydroviews.errors import InputError
from hydroviews.files.atomic import is_there
from hydroviews.formats import llff, nerfstudio
from hydroviews.formats.capture_json import captured_rainy, described_number
from hydroviews.formats.checks.capture import compare
from hydroviews.formats.checks.hidden import hidden_by_masks
from hydroviews.formats.colmap import find_models, read_colmap, refuse_mixed
from hydroviews.formats.llff import read_llff
from hydroviews.formats.mask_files.matching import with_masks
from hydroviews.formats.nerfstudio import read_nerfstudio
from hydroviews.formats.nsvf import is_nsvf, read_nsvf
from hydroviews.formats.paired.pictures import find_pictures
from hydroviews.formats.paired.scenes import paired_scene
from hydroviews.formats.photographs import Match, match_files, not_read, photographs_below, read_split, some
from hydroviews.formats.points.doubles import without_doubles
from hydroviews.formats.splits import with_own_split
from hydroviews.scene.file_kinds import ARCHIVES, file_kind
from hydroviews.scene.scenes import Scene

# Of a folder, the scene's name, the photographs' folder inside it, and what finds the photographs.
logger = logging.getLogger(__name__)

DEEPEST = 3  # folders down in which cameras are looked for, to name them
BUILT = "request.json"  # in a built scene's folder
Read = Callable[[Path, str, str | None, Match], Scene]

# How each format is recognised and read; the first match is taken.
READERS: tuple[tuple[Callable[[Path], bool], Read], ...] = (
    (lambda folder: bool(find_models(folder)), read_colmap),
    (
        lambda folder: is_there(folder / nerfstudio.CAMERA_FILE),
        lambda folder, name, _, match: read_nerfstudio(folder, name, match),
    ),
    (
        lambda folder: bool(nerfstudio.part_files(folder)),
        lambda folder, name, _, match: nerfstudio.read_parts(folder, name, match),
    ),
    (
        lambda folder: is_there(folder / llff.CAMERA_FILE),
        lambda folder, name, images, _: read_llff(folder, name, images),
    ),
    (is_nsvf, lambda folder, name, *_: read_nsvf(folder, name)),
)


def read_scene(folder: Path, name: str | None = None, images: str | None = None) -> Scene:
    """Read a capture: a COLMAP model, else `transforms.json`, else `poses_bounds.npy`, else NSVF's `pose`.

    The split is the folder's `split.json`, else one that the capture has in another form (see `splits`), else every 8th
    view by name is held out. `Scene.notes` says which
    cameras were taken, how many images they cover, and which of them look wrong. Masks are the capture's `masks`
    (see `hydroviews.scene.masks`); whether it was taken in rain, and how large it is, stand in its
    `capture.json`. A capture of rainy and clean photographs is read as `paired_pictures` and `paired` say.

    Args:
        folder: the capture, or a built scene or one of its rainy variants.
        name: of the scene; the folder's own by default.
        images: the photographs' folder inside it, for COLMAP and LLFF captures that have several sizes.

    Raises:
        InputError: there are no cameras, or something is wrong with them or with the photographs.
    """
    if not folder.is_dir():
        raise no_folder(folder)
    scene = _read_cameras(folder, name or folder.resolve().name, images)
    if not any((one / BUILT).is_file() for one in (folder, folder.parent)):  # a built scene was compared before
        scene = _compared(scene, folder)
    masked, notes = sum(view.mask is not None for view in scene.views), list(scene.notes)
    if masked:
        notes.append(f"{masked} of {len(scene.views)} views have a mask")
    rainy = captured_rainy(folder) or scene.captured_rainy
    if rainy and not scene.clean_views:
        notes.append("taken in rain: there are no clean views to compare with")
    return replace(
        scene,
        notes=tuple(notes),
        captured_rainy=rainy,
        metres_per_unit=described_number(folder, "metres_per_unit"),
        clean_error=described_number(folder, "clean_error"),
        drops_cost=described_number(folder, "drops_cost") or 1.0,
    )


def _compared(scene: Scene, folder: Path) -> Scene:
    """The scene with masks of all kinds of names; warns of whatever in the capture contradicts the rest of it."""
    scene, left_over = with_masks(scene, folder)
    said, points = hidden_by_masks(scene), without_doubles(scene.points)
    if len(points) < len(scene.points):
        doubles = len(scene.points) - len(points)
        left_over.append(f"{doubles} of {len(scene.points)} points are doubles, in the places of others, and left out")
    scene = with_own_split(replace(scene, points=points), folder)
    for warning in (*left_over, *said.warnings, *compare(scene)):
        logger.warning(warning)
    return replace(scene, notes=(*scene.notes, *said.notes, *left_over))


def no_folder(path: Path) -> InputError:
    """The error for a capture that is a file, such as an archive, or that is not there."""
    if not path.is_file():
        return InputError(f"{path}: no such folder")
    kind = file_kind(path) or "of an unknown kind"
    fix = (
        "unpack it, and give the folder" if ARCHIVES in kind else "give the folder that cameras and photographs are in"
    )
    return InputError(f"{path}: a file, not a folder", found=kind, expected="a folder with photographs", fix=fix)


def has_cameras(folder: Path) -> bool:
    """Whether `read_scene` would find cameras there, valid or not."""
    return any(is_one(folder) for is_one, _ in READERS)


def _archives(folder: Path) -> str:
    """Archives in a folder without cameras, as a sentence; empty if there are none."""
    kinds = {path.name: file_kind(path) for path in sorted(folder.iterdir()) if path.is_file()}
    return ", ".join(f"{name}, {kind}: unpack it" for name, kind in kinds.items() if ARCHIVES in kind)


def _captures_below(folder: Path) -> list[Path]:
    """Folders with cameras inside a folder without any, such as the `dense/0` of COLMAP's automatic reconstruction."""
    found: list[Path] = []
    for here, folders, _ in os.walk(folder):
        path = Path(here)
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        if path != folder and has_cameras(path):
            found.append(path)
            folders.clear()
        if len(path.relative_to(folder).parts) >= DEEPEST:
            folders.clear()
    return found


def _read_cameras(folder: Path, name: str, images: str | None) -> Scene:
    for is_one, read in READERS:
        if is_one(folder):
            pictures = find_pictures(folder, images)
            if pictures is None:
                return read(folder, name, images, match_files)
            photographs = pictures.folders[0].relative_to(folder).as_posix()
            return paired_scene(read(folder, name, photographs, pictures.match), pictures, read_split(folder))
    refuse_mixed(folder)
    below = _captures_below(folder)
    if below:
        raise InputError(
            f"{folder}: no cameras",
            found=f"cameras in {some([one.relative_to(folder).as_posix() for one in below])}",
            expected=f"sparse/0, {nerfstudio.CAMERA_FILE} or {llff.CAMERA_FILE} in the folder itself",
            fix=f"give that folder: {below[0]}",
        )
    count = len(photographs_below(folder))
    nothing = not_read(folder) or _archives(folder) or "neither cameras nor photographs"
    raise InputError(
        f"{folder}: no cameras",
        found=f"{count} photographs and no camera file" if count else nothing,
        expected=f"sparse/0, {nerfstudio.CAMERA_FILE} or {llff.CAMERA_FILE}",
        fix="estimate the poses: hydroviews poses IMAGES" if count else "check the path",
    )
