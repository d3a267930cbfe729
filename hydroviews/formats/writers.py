"""Scenes as COLMAP and nerfstudio projects, so that any other reconstruction code can open them."""

import errno
import os
from pathlib import Path
from typing import Any

import numpy as np
from plyfile import PlyData, PlyElement

from hydroviews.errors import InputError
from hydroviews.files import ownership
from hydroviews.files.atomic import write_json
from hydroviews.files.full_disk import plain_full_disk
from hydroviews.files.temporary import temporary_beside
from hydroviews.formats.colmap_format import read_cameras, read_images, read_points
from hydroviews.formats.geometry import OPENGL_TO_OPENCV, inverse
from hydroviews.scene.cameras import Camera
from hydroviews.scene.masks import MASKS
from hydroviews.scene.quiet_pycolmap import pycolmap
from hydroviews.scene.scenes import Points, Scene

MODEL = Path("sparse", "0")
POINT_CLOUD = "points3D.ply"
MODEL_FILES = (*(f"{kind}.bin" for kind in ("cameras", "images", "points3D", "frames", "rigs")), POINT_CLOUD)


def write_colmap(scene: Scene, folder: Path) -> None:
    """Write a COLMAP model: PINHOLE cameras, one for all views of the same intrinsics, poses, and points.

    Images are called `<view name>.png`. Points have no tracks. Beside COLMAP's own files goes `points3D.ply`,
    for code that starts from a point cloud. The folder appears whole or not at all; an old one of ours is replaced.

    Args:
        scene: what to write.
        folder: the model's, such as `<project>/sparse/0`.

    Raises:
        InputError: the disk is full, or somebody else's files are in the folder.
    """
    with plain_full_disk(folder), temporary_beside(folder) as partial:
        partial.mkdir()
        to_reconstruction(scene).write_binary(partial)
        check_whole(partial)
        _write_ply(scene.points, partial / POINT_CLOUD)
        ownership.clear(folder, [folder / name for name in MODEL_FILES])
        ownership.enter(folder, partial)
        os.replace(partial, folder)


def check_whole(model: Path) -> None:
    """Refuse a COLMAP model that is cut short: pycolmap does not report a full disk.

    Raises:
        OSError: it is cut short, with the error number of a full disk.
    """
    try:
        for read in (read_cameras, read_images, read_points):
            read(model)
    except InputError as error:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)) from error


def to_reconstruction(scene: Scene) -> pycolmap.Reconstruction:
    """The scene as pycolmap's object: image ids count from 1 in the order of the views."""
    model = pycolmap.Reconstruction()
    camera_ids: dict[tuple, int] = {}
    for image_id, view in enumerate(scene.views, start=1):
        intrinsics = _intrinsics(view.camera)
        if intrinsics not in camera_ids:
            camera_ids[intrinsics] = len(camera_ids) + 1
            model.add_camera_with_trivial_rig(to_colmap_camera(view.camera, camera_ids[intrinsics]))
        image = pycolmap.Image(name=f"{view.name}.png", camera_id=camera_ids[intrinsics], image_id=image_id)
        model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(view.camera.world_to_camera[:3]))
    for position, colour in zip(scene.points.positions, scene.points.colours, strict=True):
        model.add_point3D(position, pycolmap.Track(), colour)
    return model


def to_colmap_camera(camera: Camera, camera_id: int) -> pycolmap.Camera:
    """The camera's intrinsics as a COLMAP PINHOLE camera."""
    width, height, *params = _intrinsics(camera)
    return pycolmap.Camera(model="PINHOLE", width=width, height=height, params=params, camera_id=camera_id)


def _intrinsics(camera: Camera) -> tuple:
    return camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy


def _write_ply(points: Points, path: Path) -> None:
    """A point cloud with the fields that 3D Gaussian splatting codes look for; normals are zero, not known."""
    places = [(axis, "f8") for axis in "xyz"]  # float32 is off by decimetres in the coordinates of a country
    fields = [*places, *((axis, "f4") for axis in ("nx", "ny", "nz")), *((channel, "u1") for channel in _CHANNELS)]
    vertices = np.zeros(len(points), fields)
    for i, axis in enumerate("xyz"):
        vertices[axis] = points.positions[:, i]
    for i, channel in enumerate(_CHANNELS):
        vertices[channel] = points.colours[:, i]
    PlyData([PlyElement.describe(vertices, "vertex")]).write(path)


_CHANNELS = ("red", "green", "blue")


def write_nerfstudio(scene: Scene, path: Path, image_folder_name: str) -> None:
    """Write `transforms.json`: camera-to-world matrices with OpenGL axes, every frame with its own intrinsics.

    A point cloud that `write_colmap` left in `sparse/0` beside it is named in it; so are masks, in `masks` beside it.

    Args:
        scene: what to write.
        path: of the file.
        image_folder_name: folder of `<view name>.png`, relative to the file.
    """
    content: dict[str, Any] = {"camera_model": "OPENCV"}  # nerfstudio's name; without coefficients, a pinhole
    if (path.parent / MODEL / POINT_CLOUD).is_file():
        content["ply_file_path"] = (MODEL / POINT_CLOUD).as_posix()
    content["frames"] = [
        {
            "file_path": f"{image_folder_name}/{view.name}.png",
            **({"mask_path": f"{MASKS}/{view.mask.name}"} if view.mask else {}),
            **dict(zip(("w", "h", "fl_x", "fl_y", "cx", "cy"), _intrinsics(view.camera), strict=True)),
            "transform_matrix": (inverse(view.camera.world_to_camera) @ OPENGL_TO_OPENCV).tolist(),
        }
        for view in scene.views
    ]
    write_json(path, content)
