"""LLFF captures: `poses_bounds.npy` beside photographs, matched in sorted order."""

from pathlib import Path
from tokenize import TokenError

import numpy as np
from numpy.typing import NDArray

from hydroviews.errors import InputError
from hydroviews.files.atomic import as_file
from hydroviews.formats.geometry import inverse, misplaced_note, rigid_pose
from hydroviews.formats.photographs import (
    image_folder,
    make_view,
    mask_beside,
    photographs_below,
    read_split,
    some,
    view_names,
)
from hydroviews.scene.lenses import named_lens
from hydroviews.scene.scenes import Scene, make_scene, no_points

CAMERA_FILE = "poses_bounds.npy"


def read_llff(folder: Path, name: str, images: str | None = None) -> Scene:
    """Read an LLFF capture; the photographs may be smaller than the file says, of the same shape.

    The file holds a row of 17 numbers a photograph: a [3, 5] matrix [R | t | hwf] and the nearest and farthest
    depth. The columns of R are the camera's down, right and backward axes in the world.

    Raises:
        InputError: a damaged file, one for another number of photographs, or photographs of another shape.
    """
    path = folder / CAMERA_FILE
    table = _read_table(path)
    photographs = image_folder(folder, images)
    files = photographs_below(photographs)
    if len(files) != len(table):
        raise InputError(
            f"{path}: a camera file for other images",
            found=f"{len(table)} cameras, {len(files)} images in {photographs} ({some([p.name for p in files])})",
            expected="one camera an image, in the order of their names",
            fix="put back the images it was made from, and no others",
        )
    names = view_names([file.relative_to(photographs).as_posix() for file in files])
    views = []
    for view_name, file, row in zip(names, files, table, strict=True):
        matrix = row[:15].reshape(3, 5)
        height, width, focal = matrix[:, 4]
        where = f"{path}: {view_name}"
        lens = named_lens(where, "SIMPLE_PINHOLE", round(width), round(height), (focal, width / 2, height / 2))
        pose = _world_to_camera(matrix, where)
        views.append(make_view(view_name, file, lens, pose, mask_beside(folder, photographs, file)))
    notes = [f"cameras from {CAMERA_FILE}: {len(views)} images", "the capture has no points"]
    notes += misplaced_note(names, [view.camera.centre for view in views])
    return make_scene(name, views, no_points(), read_split(folder), notes)


def _read_table(path: Path) -> NDArray[np.float64]:
    """Rows of 17 numbers, with finite sizes and focal lengths."""
    try:
        # Mapped, so that no memory is reserved for what the file does not hold.
        with np.errstate(over="ignore"):
            table = np.load(as_file(path), mmap_mode="r", allow_pickle=False)
    except (OSError, ValueError, TypeError, EOFError, SyntaxError, TokenError, OverflowError) as error:
        # Headers are Python code, and their shapes any numbers.
        raise InputError(f"{path}: not a NumPy array", found=error, fix="copy the file again") from error
    if not isinstance(table, np.ndarray):
        table.close()
        raise InputError(f"{path}: not a NumPy array", found="an archive of arrays", expected="one array, a .npy file")
    if table.ndim != 2 or table.shape[1] != 17 or table.dtype.kind != "f":
        raise InputError(
            f"{path}: not an LLFF camera file",
            found=f"{table.dtype} of shape {table.shape}",
            expected="floating-point [images, 17]",
        )
    sizes = table[:, [4, 9, 14]]
    if not np.isfinite(sizes).all():
        raise InputError(f"{path}: bad heights, widths or focal lengths", found=sizes.min(axis=0))
    return table.astype(np.float64)


def _world_to_camera(matrix: NDArray[np.float64], where: str) -> NDArray[np.float64]:
    down, right, backward, position = matrix[:, :4].T
    return inverse(rigid_pose(np.stack([right, down, -backward, position], axis=1), where))
