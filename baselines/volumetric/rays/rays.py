"""Rays of cameras: pixel centres at +0.5, OpenCV axes, and how far along them the scene lies."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hydroviews.scene.cameras import Camera
from hydroviews.scene.scenes import Points

FEWEST = 20  # points that an image must show for its depths to count
SHARE = 0.1  # percent of an image's points that may lie nearer than `near`, and as many beyond `far`
NEAREST = 0.01  # near is at least this share of the median depth: a misplaced camera may stand among the points
DEFAULT = 0.1, 10.0  # near and far of a scene without points, in extents of its cameras


@dataclass(frozen=True)
class WorldRays:
    """R rays in world units; a point at depth t, along the camera's axis, is origin + t direction."""

    origins: NDArray[np.float64]  # [R, 3]
    directions: NDArray[np.float64]  # [R, 3], as long as they are per unit of depth


class CameraArrays:
    """The cameras of many views in arrays, so that rays of different views are made at once."""

    def __init__(self, cameras: Sequence[Camera]):
        self._lens = np.array([[c.fx, c.fy, c.cx, c.cy] for c in cameras])
        self._rotations = np.stack([c.rotation for c in cameras])
        self._centres = np.stack([c.centre for c in cameras])

    def rays(self, views: NDArray[np.int64], columns: NDArray, rows: NDArray) -> WorldRays:
        """Rays through points of images.

        Args:
            views: index of the camera [R].
            columns, rows: positions in pixels [R]; the centre of the first pixel is (0.5, 0.5).
        """
        fx, fy, cx, cy = self._lens[views].T
        local = np.stack([(columns - cx) / fx, (rows - cy) / fy, np.ones(len(views))], axis=1)
        directions = np.einsum("rij,ri->rj", self._rotations[views], local)
        return WorldRays(self._centres[views], directions)


def camera_rays(camera: Camera) -> WorldRays:
    """The rays of all pixels [H W], row by row."""
    rows, columns = np.mgrid[: camera.height, : camera.width] + 0.5
    return CameraArrays([camera]).rays(np.zeros(rows.size, np.int64), columns.ravel(), rows.ravel())


def depth_range(cameras: Sequence[Camera], points: Points, extent: float) -> tuple[float, float]:
    """Smallest near and largest far of the images: 0.1 and 99.9 percentiles of the depths of points that each shows.

    Args:
        cameras: of the training views.
        points: of the scene; where no image shows 20 of them, the range follows from the extent alone.
        extent: of the cameras, in world units.
    """
    ranges, middles = [], []
    for camera in cameras:
        pixels, depths = camera.project(points.positions)
        inside = ((pixels >= 0) & (pixels <= (camera.width, camera.height))).all(axis=1)
        seen = depths[inside & (depths > 0) & np.isfinite(depths)]
        if len(seen) >= FEWEST:
            ranges.append(np.percentile(seen, (SHARE, 100 - SHARE)))
            middles.append(np.median(seen))
    if not ranges:
        return DEFAULT[0] * extent, DEFAULT[1] * extent
    nearest, farthest = np.min(ranges, axis=0)[0], np.max(ranges, axis=0)[1]
    return float(max(nearest, NEAREST * np.median(middles))), float(farthest)
