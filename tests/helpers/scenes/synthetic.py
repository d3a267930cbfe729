"""A small capture made on the spot: textured pictures, cameras on a ring, points inside it."""

from pathlib import Path

import numpy as np

from hydroviews.formats.writers import write_colmap
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import write_png
from hydroviews.scene.scenes import Points, Scene, View, make_scene


def looking_at_origin(eye: np.ndarray) -> np.ndarray:
    """World to camera [4, 4], of an upright camera at [3]."""
    forward = -eye / np.linalg.norm(eye)
    right = np.cross(forward, [0, -1.0, 0])
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(forward, right), forward])
    pose[:3, 3] = -pose[:3, :3] @ eye
    return pose


def ring_camera(angle: float, width: int, height: int) -> Camera:
    """A camera at distance 4 from the origin, looking at it."""
    pose = looking_at_origin(4 * np.array([np.cos(angle), -0.2, np.sin(angle)]))
    return Camera(width, height, 0.9 * width, 0.9 * width, width / 2, height / 2, pose)


def capture_in(folder: Path, n_views: int = 9, width: int = 48, height: int = 36, seed: int = 0) -> Scene:
    """Write pictures to `folder/images` and return the scene named like the folder."""
    rng = np.random.default_rng(seed)
    views = []
    for i in range(n_views):
        coarse = rng.random((4, 4, 3)).repeat(-(-height // 4), 0)[:height].repeat(-(-width // 4), 1)[:, :width]
        path = folder / "images" / f"view-{i:02d}.png"
        write_png(path, (0.2 + 0.6 * coarse).astype(np.float32))
        views.append(View(path.stem, ring_camera(2 * np.pi * i / n_views, width, height), path))
    points = Points(rng.uniform(-1, 1, (40, 3)), rng.integers(0, 256, (40, 3)).astype(np.uint8))
    return make_scene(folder.name, views, points)


def written_capture(folder: Path, **options: int) -> Path:
    """The same as a COLMAP project in a folder, which is returned."""
    write_colmap(capture_in(folder, **options), folder / "sparse" / "0")
    return folder
