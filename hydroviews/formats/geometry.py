"""Checks of poses from files: nearly rigid ones are made rigid, others refused; cameras out of place are noted."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hydroviews.errors import InputError
from hydroviews.scene.checks import check_position

RIGID_TOLERANCE = 0.02  # largest deviation of a singular value from 1 that counts as rounding
JUMP = 10.0  # distance from its neighbours, in median steps, from which a camera is doubtful
WINDOW = 3  # neighbours compared with on either side, by name

# A camera's y and z axes point the other way in OpenGL (x right, y up, z backwards) than in OpenCV.
OPENGL_TO_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])


def rigid_pose(pose: ArrayLike, where: str) -> NDArray[np.float64]:
    """A rigid [4, 4] from a [3, 4] or [4, 4] matrix: its rotation becomes the nearest orthonormal matrix.

    Args:
        pose: camera-to-world or world-to-camera.
        where: file and view, for errors.

    Raises:
        InputError: another size, not finite, mirrored, scaled or sheared by more than RIGID_TOLERANCE, or too far away
            (see `scene.checks`).
    """
    try:
        matrix = np.asarray(pose, np.float64)
    except (TypeError, ValueError, OverflowError):
        matrix = np.zeros(0)
    if matrix.shape not in ((3, 4), (4, 4)):
        raise InputError(f"{where}: the pose is not a matrix of numbers", found=pose, expected="4 rows of 4 numbers")
    fix = "write the camera file again, or remove this view from it"
    if not np.isfinite(matrix).all():
        raise InputError(f"{where}: the pose has numbers that are not finite", found=matrix.tolist(), fix=fix)
    check_position(where, matrix[:3, 3])
    left, stretch, right = np.linalg.svd(matrix[:3, :3])
    rotation = left @ right
    mirrored = np.linalg.det(rotation) < 0
    if mirrored or not np.abs(stretch - 1).max() <= RIGID_TOLERANCE:
        raise InputError(
            f"{where}: the pose is not rigid",
            found=f"rotation part with singular values {', '.join(f'{s:.4g}' for s in stretch)}"
            + (", mirrored" if mirrored else ""),
            expected=f"1 within {RIGID_TOLERANCE:.0%}, not mirrored",
            fix=fix,
        )
    rigid = np.eye(4)
    rigid[:3, :3] = rotation
    rigid[:3, 3] = matrix[:3, 3]
    return rigid


def inverse(pose: NDArray[np.float64]) -> NDArray[np.float64]:
    """The inverse of a rigid [4, 4], exactly rigid again."""
    result = np.eye(4)
    result[:3, :3] = pose[:3, :3].T
    result[:3, 3] = -pose[:3, :3].T @ pose[:3, 3]
    return result


def misplaced(centres: ArrayLike) -> list[int]:
    """Cameras far from all but at most one of the views around them in a sequence.

    Registered does not mean right: a wrong match can throw one or two photographs of a sequence far off.
    One near neighbour is not enough, since wrong cameras come in pairs; two are, since a sequence may jump.

    Args:
        centres: camera positions [N, 3] in order of the views' names.

    Returns:
        Indices, ascending. Photographs in no spatial order have large steps, and none stands out.
    """
    positions = np.asarray(centres, np.float64)
    if len(positions) < 2 * WINDOW + 2:
        return []
    step = np.median(np.linalg.norm(np.diff(positions, axis=0), axis=1))
    doubtful = []
    for i, position in enumerate(positions):
        around = np.r_[positions[max(0, i - WINDOW) : i], positions[i + 1 : i + 1 + WINDOW]]
        second_nearest = np.sort(np.linalg.norm(around - position, axis=1))[1]
        if second_nearest > JUMP * step:
            doubtful.append(i)
    return doubtful


def misplaced_note(names: Sequence[str], centres: ArrayLike) -> list[str]:
    """A sentence about `misplaced` cameras, if there are any."""
    found = [names[i] for i in misplaced(centres)]
    if not found:
        return []
    return [
        f"{', '.join(found)}: more than {JUMP:.0f} median steps away from the views next to "
        f"{'it' if len(found) == 1 else 'them'} by name; probably registered in the wrong place"
    ]
