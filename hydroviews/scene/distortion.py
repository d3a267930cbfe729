"""Whether a lens's distortion shows every direction once: it may turn back on itself, or lead off the photograph."""

import numpy as np
from numpy.typing import NDArray

from hydroviews.scene.quiet_pycolmap import pycolmap

GRID = 17  # places along each side of a picture at which its distortion is checked
SLACK = 0.05  # of the longer side: how far beyond the photograph a place may lie, for rounding

_PLACES = np.stack(np.meshgrid(*2 * [np.linspace(0, 1, GRID)]), axis=-1).reshape(1, -1, 2)  # of the picture
_STEPS = np.array([[-0.5, 0], [0.5, 0], [0, -0.5], [0, 0.5]]).reshape(4, 1, 2)  # pixels


def misuse(photograph: pycolmap.Camera, undistorted: pycolmap.Camera) -> str:
    """How a picture that is undistorted so would show its photograph wrongly.

    The map from the one to the other is one to one where its Jacobian determinant stays positive, and upright where its
    diagonal does. Both are taken by central differences at GRID places a side, corners and edges among them: distortion
    that grows with the distance from the middle turns there first. What lies beyond the undistorted picture does not
    count; wide lenses often fold in corners that are cut off.

    Args:
        photograph: any camera.
        undistorted: a pinhole camera.

    Returns:
        "folds inside" or "leads outside" the photograph; empty if it does neither.
    """
    matrix = undistorted.calibration_matrix()
    ends = _PLACES * (undistorted.width, undistorted.height) + _STEPS - matrix[:2, 2]
    rays = np.ones((ends.size // 2, 3))
    rays[:, :2] = ends.reshape(-1, 2) / (matrix[0, 0], matrix[1, 1])
    sampled: NDArray[np.float64] = np.asarray(photograph.img_from_cam(rays))
    left, right, above, below = sampled.reshape(4, -1, 2)
    with np.errstate(over="ignore", invalid="ignore"):
        (xx, xy), (yx, yy) = (right - left).T, (below - above).T
        upright = (xx * yy > xy * yx) & (xx > 0) & (yy > 0)  # NaN is not
    if not upright.all():
        return "folds inside"
    size = np.array([photograph.width, photograph.height])
    outside = np.abs(sampled - size / 2) - size / 2
    return "leads outside" if outside.max() > SLACK * size.max() else ""
