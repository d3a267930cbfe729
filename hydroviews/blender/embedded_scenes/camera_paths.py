"""Where photographs of an embedded scene are taken."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hydroviews.scene.cameras import Camera
from hydroviews.scene.scenes import TEST_EVERY

STEP = np.radians(12)  # the widest angle between neighbouring training views
RING = 2 * np.pi


@dataclass(frozen=True)
class Path:
    """A wavy ring, or an arc of one, and what the cameras on it look at. Lengths are metres, angles radians."""

    radius: float
    radius_spread: float
    height: float
    height_spread: float
    target: tuple[float, float, float]
    target_spread: float
    centre: tuple[float, float] = (0.0, 0.0)
    start: float = 0.0  # anticlockwise from +x
    span: float = RING
    waves: tuple[float, float] = (3.0, 5.0)  # of the radius and of the height, a ring
    outward: bool = False  # cameras turn their backs to the target
    focal: float = 0.72  # focal length over image width: 70 degrees across


def place_cameras(path: Path, n_views: int, width: int, height: int, seed: int) -> list[Camera]:
    """Cameras along a path, in order.

    Training views are at most 12 degrees apart, so that few views cover only the path's beginning. Each held-out
    view (every 8th) lies midway between two training views that are next to each other, so that it asks for
    interpolation and not for what nobody saw.
    """
    held_out = np.arange(n_views) % TEST_EVERY == 0
    n_train = int((~held_out).sum())
    whole = path.span >= RING and n_train * STEP >= RING
    step = RING / n_train if whole else min(STEP, path.span / (n_train - 1))
    # In steps along the path: training views at whole numbers, held-out ones half a step further on.
    place = np.cumsum(~held_out) - 1.0
    place[held_out] += 0.5
    if not whole:  # an arc has ends, and held-out views stay off them
        place[held_out] = np.clip(place[held_out] + 1, 0.5, n_train - 1.5)
    wobble = np.random.default_rng(seed).uniform(-1, 1, (n_train, 4))
    cameras = []
    for at in place:
        low, share = int(np.floor(at)), at - np.floor(at)
        offset = (1 - share) * wobble[low % n_train] + share * wobble[(low + 1) % n_train]
        cameras.append(_camera(path, path.start + at * step, offset, width, height))
    return cameras


def _camera(path: Path, angle: float, offset: NDArray[np.float64], width: int, height: int) -> Camera:
    radius = path.radius + path.radius_spread * (0.5 * offset[0] + 0.5 * np.sin(path.waves[0] * angle))
    eye_height = path.height + path.height_spread * (0.6 * offset[1] + 0.4 * np.sin(path.waves[1] * angle))
    x, y = path.centre
    eye = np.array([x + radius * np.cos(angle), y + radius * np.sin(angle), eye_height])
    target = np.array(path.target) + path.target_spread * np.array([offset[2], offset[3], 0.0])
    sight = eye - target if path.outward else target - eye
    forward = sight / np.linalg.norm(sight)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(forward, right), forward])
    pose[:3, 3] = -pose[:3, :3] @ eye
    focal = path.focal * width
    return Camera(width, height, focal, focal, width / 2, height / 2, pose)
