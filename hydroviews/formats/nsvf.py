"""NSVF captures (as Tanks and Temples is often distributed): `rgb/*.png`, `pose/*.txt` and `intrinsics.txt`."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hydroviews.errors import InputError
from hydroviews.files.atomic import as_file
from hydroviews.formats.geometry import inverse, misplaced_note, rigid_pose
from hydroviews.formats.photographs import make_view, mask_beside, photographs_below, read_split, some, view_names
from hydroviews.scene.images import image_size
from hydroviews.scene.lenses import named_lens
from hydroviews.scene.scenes import Scene, make_scene, no_points

IMAGES, POSES, INTRINSICS = "rgb", "pose", "intrinsics.txt"


def is_nsvf(folder: Path) -> bool:
    """Whether the folder has NSVF's layout."""
    return all((folder / name).is_dir() for name in (IMAGES, POSES)) and (folder / INTRINSICS).is_file()


def read_nsvf(folder: Path, name: str) -> Scene:
    """Read an NSVF capture: a camera-to-world matrix [4, 4] with OpenCV axes for every photograph.

    The prefixes of file names (0_ training, 1_ and 2_ held out) are ignored: every 8th view by name is held out, as in
    all formats.

    Raises:
        InputError: a photograph without a pose, or numbers that are no pose or no intrinsics.
    """
    files = photographs_below(folder / IMAGES)
    stems = [file.relative_to(folder / IMAGES).with_suffix("") for file in files]
    poses = [folder / POSES / f"{stem}.txt" for stem in stems]
    missing = [path.name for path in poses if not path.is_file()]
    if missing or not files:
        raise InputError(
            f"{folder / POSES}: {len(missing)} of {len(files)} photographs have no pose",
            found="no " + some(missing),
            expected=f"a file of 4 rows of 4 numbers for each photograph in {folder / IMAGES}",
            fix="copy the missing files again",
        )
    intrinsics = _read_intrinsics(folder / INTRINSICS)
    names = view_names([stem.as_posix() for stem in stems])
    views = []
    for view_name, file, pose in zip(names, files, poses, strict=True):
        camera_to_world = rigid_pose(_read_numbers(pose), f"{pose}: {view_name}")
        lens = named_lens(f"{folder / INTRINSICS}", "PINHOLE", *image_size(file), intrinsics)
        mask = mask_beside(folder, folder / IMAGES, file)
        views.append(make_view(view_name, file, lens, inverse(camera_to_world), mask))
    notes = [f"cameras from {POSES}: {len(views)} images", "the capture has no points"]
    notes += misplaced_note(names, [view.camera.centre for view in views])
    return make_scene(name, views, no_points(), read_split(folder), notes)


def _read_intrinsics(path: Path) -> tuple[float, float, float, float]:
    """Focal lengths and principal point in pixels, from a matrix [4, 4] or from a first row f, cx, cy."""
    rows = _read_rows(path)
    if len(rows) in (3, 4) and all(len(row) == len(rows) for row in rows):
        values = rows[0][0], rows[1][1], rows[0][2], rows[1][2]
    elif rows and len(rows[0]) >= 3:
        values = rows[0][0], rows[0][0], rows[0][1], rows[0][2]
    else:
        raise InputError(f"{path}: no focal length", found=rows[:2], expected="a matrix of 4 by 4, or f cx cy")
    return values


def _read_numbers(path: Path) -> NDArray[np.float64]:
    rows = _read_rows(path)
    if len({len(row) for row in rows}) != 1:
        raise InputError(f"{path}: not a pose", found=f"{len(rows)} rows", expected="4 rows of 4 numbers")
    return np.array(rows)


def _read_rows(path: Path) -> list[list[float]]:
    try:
        lines = as_file(path).read_text("utf-8-sig").splitlines()
        return [[float(word) for word in line.split()] for line in lines if line.strip()]
    except ValueError as error:  # UnicodeDecodeError is one too
        raise InputError(f"{path}: not numbers", found=error, fix="copy the file again") from None
