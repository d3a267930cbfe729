"""Captures with a distorting lens, made on the spot: photographs whose colours are a function of the ray."""

from pathlib import Path

import numpy as np
import pycolmap
from numpy.typing import NDArray
from synthetic import ring_camera

from hydroviews.scene.images import write_png
from hydroviews.scene.lenses import Lens

LENS = Lens("OPENCV", 96, 72, (80.0, 82.0, 47.0, 37.0, -0.12, 0.03, 0.001, -0.002))


def colours(rays: NDArray[np.float64]) -> NDArray[np.float32]:
    """A smooth picture [..., 3] in [0.1, 0.9] of camera rays [..., 2] (x / z, y / z)."""
    x, y = rays[..., 0], rays[..., 1]
    waves = [np.sin(4 * x + y), np.cos(3 * y - 2 * x), np.sin(3 * x * y + 1)]
    return (0.5 + 0.4 * np.stack(waves, axis=-1)).astype(np.float32)


def photograph(lens: Lens) -> NDArray[np.float32]:
    """What the lens sees of `colours`: float32 [H, W, 3]."""
    columns, rows = np.meshgrid(np.arange(lens.width) + 0.5, np.arange(lens.height) + 0.5)
    pixels = np.stack([columns, rows], axis=-1).reshape(-1, 2)
    rays = lens.colmap().cam_from_img(pixels).reshape(lens.height, lens.width, 2)
    return colours(np.nan_to_num(rays))


def write_photographs(folder: Path, names: list[str], lens: Lens = LENS) -> None:
    """The same picture under each name."""
    image = photograph(lens)
    for name in names:
        write_png(folder / name, image)


def arc(count: int) -> list[NDArray[np.float64]]:
    """World-to-camera poses [4, 4] on an arc, looking at the origin."""
    return [ring_camera(0.1 * i, 4, 3).world_to_camera for i in range(count)]


def write_model(folder: Path, names: list[str], lens: Lens = LENS, text: bool = False) -> None:
    """A COLMAP model with `lens`, poses on the arc, and ten points without tracks."""
    model = pycolmap.Reconstruction()
    model.add_camera_with_trivial_rig(lens.colmap())
    for number, (name, pose) in enumerate(zip(names, arc(len(names)), strict=True), start=1):
        image = pycolmap.Image(name=name, camera_id=1, image_id=number)
        model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(pose[:3]))
    for i in range(10):
        model.add_point3D(np.array([0.1 * i, 0, 0.2]), pycolmap.Track(), np.array([i, 100, 255], np.uint8))
    folder.mkdir(parents=True, exist_ok=True)
    (model.write_text if text else model.write_binary)(folder)


def colmap_capture(folder: Path, count: int = 9, text: bool = False) -> Path:
    """A COLMAP project with distorted photographs `view00.png`...; returns `folder`."""
    names = [f"view{i:02d}.png" for i in range(count)]
    write_photographs(folder / "images", names)
    write_model(folder / "sparse" / "0", names, text=text)
    return folder
