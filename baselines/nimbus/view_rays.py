"""The rays of a view, from the camera to what has been learned of the scene, and where they are in the medium's box."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from baselines.splatting.strategies.initialisation import scene_extent
from hydroviews.scene.cameras import Camera

SIDE = 2.0  # of the box, in extents of the points without their outermost hundredths (the paper)
TAIL = 0.01  # of the points, at each end of an axis, that their extent leaves out
LEAST = 1e-9  # of a direction's parts, which are divided by


@dataclass(frozen=True)
class Box:
    """Where the grid lies, in world units."""

    middle: NDArray[np.float64]  # [3]
    reach: NDArray[np.float64]  # [3], half of its sides
    unit: float  # median distance from a camera to a scene point


@dataclass(frozen=True)
class Rays:
    """Rays from one point; in the box's units, in which it reaches from -1 to 1 along each axis."""

    origin: Tensor  # [3]
    directions: Tensor  # [P, 3], of one world unit
    distances: Tensor  # [P], world units; infinite where a ray meets nothing

    def inside(self) -> tuple[Tensor, Tensor]:
        """Where rays are in the box for the first time, and for how long, before they end; world units [P] each."""
        tilt = torch.where(self.directions.abs() < LEAST, LEAST, self.directions)
        faces = torch.stack([(-1 - self.origin) / tilt, (1 - self.origin) / tilt])
        entry = faces.amin(dim=0).amax(dim=1).clamp(min=0)
        leave = torch.minimum(faces.amax(dim=0).amin(dim=1), self.distances)
        length = (leave - entry).clamp(min=0)
        return torch.where(length > 0, entry, 0), length


def box_around(points: NDArray[np.floating], cameras: Sequence[Camera], factor: float = SIDE) -> Box:
    """A box in the middle of the points [N, 3], `factor` times as large as nearly all of them need.

    Without points it is a cube around the cameras.
    """
    middle, extent = scene_extent(cameras, points)
    points = points[np.isfinite(points).all(axis=1)]
    if not len(points):
        return Box(middle, np.full(3, factor * extent), extent)
    low, high = np.quantile(points, TAIL, axis=0), np.quantile(points, 1 - TAIL, axis=0)
    reach = np.maximum(factor * (high - low) / 2, 1e-6 * extent)
    distances = [np.linalg.norm(points - camera.centre, axis=1) for camera in cameras]
    return Box((low + high) / 2, reach, max(float(np.median(distances)), 1e-6 * extent))


def rays_of(camera: Camera, depth: NDArray[np.float32], box: Box, device: torch.device | None = None) -> Rays:
    """The rays through the middles of a picture's pixels, row by row.

    Args:
        camera: of the view, at the size of the depth.
        depth: along the viewing axis [H, W], world units; NaN or infinite where there is none.
        box: whose units the rays are in.
        device: where to calculate.
    """
    across, down = camera.slopes
    local = np.stack([*np.meshgrid(across, down), np.ones((camera.height, camera.width))], axis=-1).reshape(-1, 3)
    longer = np.linalg.norm(local, axis=1)
    distances = np.where(np.isfinite(depth), depth, np.inf).reshape(-1).clip(min=0) * longer
    directions = local / longer[:, None] @ camera.rotation / box.reach
    origin = (camera.centre - box.middle) / box.reach
    arrays = (np.asarray(values, np.float32) for values in (origin, directions, distances))
    return Rays(*(torch.from_numpy(values).to(device) for values in arrays))


def small_camera(camera: Camera, shrink: int) -> Camera:
    """The same camera, through whose smaller picture rays are cast."""
    return camera.resized(*(max(1, round(side / shrink)) for side in (camera.width, camera.height)))
