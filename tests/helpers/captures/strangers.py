"""The same small capture in every format, with one thing in it that may be wrong."""

import json
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pycolmap
from distorted import arc
from plyfile import PlyData, PlyElement

from hydroviews.scene.images import write_png

FORMATS = ("colmap text", "colmap binary", "nerfstudio", "llff", "nsvf")
WITH_NAMES = FORMATS[:3]  # formats whose camera file names the photographs and holds points
TO_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])


@dataclass(frozen=True)
class Stranger:
    """What a capture of four views is said to be."""

    focal: float = 80.0
    size: tuple[float, float] = (96, 72)  # in the camera file; photographs have 96x72
    distance: float | None = None  # along x, of the third camera from the world's origin
    name: str = "2.png"  # of the third photograph
    model: str = "PINHOLE"  # of COLMAP, and the coefficients after fx, fy, cx, cy
    distortion: tuple[float, ...] = ()
    points: Sequence[tuple] = ((0.0, 0.0, 0.2, 10, 20, 30), (0.1, 0.0, 0.2, 10, 20, 30))
    camera_ids: tuple[int, ...] = (1,)
    image_ids: tuple[int, ...] = (1, 2, 3, 4)
    point_ids: tuple[int, ...] = (1, 2)

    @property
    def names(self) -> list[str]:
        return ["0.png", "1.png", self.name, "3.png"]

    @property
    def params(self) -> tuple[float, ...]:
        return (self.focal, self.focal, 48.0, 36.0, *self.distortion)

    def poses(self) -> list[np.ndarray]:
        """World to camera."""
        poses = arc(4)
        if self.distance is not None:
            poses[2] = np.eye(4)
            poses[2][0, 3] = -self.distance
        return poses

    def quaternions(self) -> list[tuple[float, ...]]:
        turns = [pycolmap.Rigid3d(pose[:3]).rotation.quat for pose in self.poses()]
        return [(w, x, y, z) for x, y, z, w in turns]


def write(kind: str, folder: Path, stranger: Stranger) -> Path:
    """Write the capture in one of FORMATS; its photographs are called 0.png to 3.png."""
    pictures = folder / ("rgb" if kind == "nsvf" else "images")
    rng = np.random.default_rng(0)
    for i in range(4):
        write_png(pictures / f"{i}.png", rng.integers(0, 256, (72, 96, 3)).astype(np.uint8))
    writers = {"colmap text": _text, "colmap binary": _binary, "nerfstudio": _nerfstudio, "llff": _llff, "nsvf": _nsvf}
    writers[kind](folder, stranger)
    return folder


def _text(folder: Path, stranger: Stranger) -> None:
    model = folder / "sparse" / "0"
    model.mkdir(parents=True)
    width, height = stranger.size
    cameras = [_line(i, stranger.model, f"{width:.0f}", f"{height:.0f}", *stranger.params) for i in stranger.camera_ids]
    (model / "cameras.txt").write_text("".join(cameras))
    rows = zip(stranger.image_ids, stranger.quaternions(), stranger.poses(), stranger.names, strict=True)
    images = [_line(i, *turn, *pose[:3, 3], 1, name) + "\n" for i, turn, pose, name in rows]
    (model / "images.txt").write_bytes("".join(images).encode("utf-8", "surrogateescape"))
    points = [_line(i, *point, 0.5) for i, point in zip(stranger.point_ids, stranger.points, strict=True)]
    (model / "points3D.txt").write_text("".join(points))


def _line(*values: object) -> str:
    return " ".join(map(str, values)) + "\n"


def _binary(folder: Path, stranger: Stranger) -> None:
    model = folder / "sparse" / "0"
    model.mkdir(parents=True)
    number = int(getattr(pycolmap.CameraModelId, stranger.model))
    size = [int(side) % 2**64 for side in stranger.size]
    cameras = [
        struct.pack(f"<IiQQ{len(stranger.params)}d", i, number, *size, *stranger.params) for i in stranger.camera_ids
    ]
    rows = zip(stranger.image_ids, stranger.quaternions(), stranger.poses(), stranger.names, strict=True)
    images = [
        struct.pack("<I7dI", i, *turn, *pose[:3, 3], 1) + name.encode("utf-8", "surrogateescape") + bytes(9)
        for i, turn, pose, name in rows
    ]
    numbered = zip(stranger.point_ids, stranger.points, strict=True)
    points = [struct.pack("<Q3d3BdQ", i, *point, 0.5, 0) for i, point in numbered]
    for file, records in (("cameras", cameras), ("images", images), ("points3D", points)):
        (model / f"{file}.bin").write_bytes(struct.pack("<Q", len(records)) + b"".join(records))


def _nerfstudio(folder: Path, stranger: Stranger) -> None:
    keys = ("fl_x", "fl_y", "cx", "cy", "k1", "k2", "p1", "p2")
    content = dict(zip(keys, stranger.params, strict=False)) | {"w": stranger.size[0], "h": stranger.size[1]}
    if stranger.model == "OPENCV_FISHEYE":
        content |= dict(zip(("k1", "k2", "k3", "k4"), stranger.distortion, strict=True)) | {"is_fisheye": True}
    content["ply_file_path"] = "points.ply"
    content["frames"] = [
        {"file_path": f"images/{name}", "transform_matrix": (np.linalg.inv(pose) @ TO_OPENGL).tolist()}
        for name, pose in zip(stranger.names, stranger.poses(), strict=True)
    ]
    (folder / "transforms.json").write_text(json.dumps(content))
    colour = "u1" if max(max(point[3:]) for point in stranger.points) < 256 else "i4"
    fields = [(axis, "f8") for axis in "xyz"] + [(channel, colour) for channel in ("red", "green", "blue")]
    vertices = np.array([tuple(point) for point in stranger.points], fields)
    PlyData([PlyElement.describe(vertices, "vertex")]).write(folder / "points.ply")


def _llff(folder: Path, stranger: Stranger) -> None:
    rows = []
    for pose in stranger.poses():
        right, down, forward, position = np.linalg.inv(pose)[:3].T
        matrix = [down, right, -forward, position, [stranger.size[1], stranger.size[0], stranger.focal]]
        rows.append([*np.stack(matrix, axis=1).ravel(), 1.0, 10.0])
    np.save(folder / "poses_bounds.npy", np.array(rows))


def _nsvf(folder: Path, stranger: Stranger) -> None:
    (folder / "pose").mkdir()
    for i, pose in enumerate(stranger.poses()):
        np.savetxt(folder / "pose" / f"{i}.txt", np.linalg.inv(pose))
    (folder / "intrinsics.txt").write_text(_line(stranger.focal, 48.0, 36.0))
