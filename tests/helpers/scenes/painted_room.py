"""A room with painted walls, exact for any camera: photographs, depth and points that fit each other."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pycolmap

from hydroviews.formats.writers import write_colmap, write_nerfstudio
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import write_png
from hydroviews.scene.scenes import Points, Scene, View, make_scene

LOW, HIGH = np.array([-3.0, -2.0, -1.0]), np.array([3.0, 2.0, 6.0])
WAVES = np.array([[2.1, 0.4, 1.3], [0.7, 2.6, -1.1], [-1.2, 0.9, 2.3]])


def paint(places):
    """Colours [..., 3] in [0, 1] of places [..., 3] on the walls."""
    return 0.5 + 0.25 * np.sin(places @ WAVES.T) + 0.2 * np.sin(3.1 * places @ WAVES[::-1].T + [0, 1, 2])


def hits(centre, rays):
    """How many times its length each ray [..., 3] from a place in the room goes until a wall."""
    with np.errstate(divide="ignore", invalid="ignore"):
        to = np.where(rays > 0, (HIGH - centre) / rays, np.where(rays < 0, (LOW - centre) / rays, np.inf))
    return to.min(axis=-1)


def depth(camera):
    """Exact depth map [H, W]."""
    return hits(camera.centre, _rays(camera)).astype(np.float32)


def picture(camera):
    """Exact photograph [H, W, 3]."""
    rays = _rays(camera)
    return paint(camera.centre + rays * hits(camera.centre, rays)[..., None]).astype(np.float32)


def _rays(camera):
    x, y = camera.slopes
    local = np.stack([*np.meshgrid(x, y), np.ones((camera.height, camera.width))], axis=-1)
    return local @ camera.rotation


def walking(i, count, width=96, height=64):
    """The camera of one of several steps along an arc, looking into the room."""
    t = 2 * i / (count - 1) - 1
    angle, centre = -0.15 * t, np.array([1.4 * t, 0.3 * np.sin(3 * t), -0.4 * t * t])
    pose = np.eye(4)
    pose[:3, :3] = [[np.cos(angle), 0, -np.sin(angle)], [0, 1, 0], [np.sin(angle), 0, np.cos(angle)]]
    pose[:3, 3] = -pose[:3, :3] @ centre
    return Camera(width, height, 0.8 * width, 0.8 * width, width / 2, height / 2, pose)


def points_on_walls(count=400, seed=0):
    """Points in front of the walking cameras, with their colours."""
    spread = np.random.default_rng(seed).uniform(-1, 1, (count, 3)) * (0.5, 0.3, 0) + (0, 0, 1)
    places = spread * hits(np.zeros(3), spread)[:, None]
    return Points(places, (255 * paint(places)).round().astype(np.uint8))


def scene_in_room(folder: Path, n_views=9, width=96, height=64, images="images", suffix=".png") -> Scene:
    """Write photographs; the scene that they are of."""
    views = []
    for i in range(n_views):
        camera, path = walking(i, n_views, width, height), folder / images / f"view-{i:02d}{suffix}"
        write_png(path, picture(camera))
        views.append(View(path.stem, camera, path))
    return make_scene(folder.name, views, points_on_walls())


def with_cameras(scene: Scene, change) -> Scene:
    """The scene with other world-to-camera matrices."""
    changed = [
        replace(view, camera=replace(view.camera, world_to_camera=change(view.camera.world_to_camera)))
        for view in scene.views
    ]
    return replace(scene, views=tuple(changed))


def write_room(scene: Scene, folder: Path, form: str) -> Path:
    """Write cameras and points beside the photographs, as "colmap" or "nerfstudio"."""
    write_colmap(scene, folder / "sparse" / "0")
    if form == "nerfstudio":
        write_nerfstudio(scene, folder / "transforms.json", "images")
        for name in ("cameras", "images"):
            (folder / "sparse" / "0" / f"{name}.bin").unlink()
    return folder


def write_text_model(scene: Scene, folder: Path, poses=None, blank=True) -> None:
    """A COLMAP text model with exact keypoints; the poses may be others than these come from."""
    folder.mkdir(parents=True, exist_ok=True)
    camera = scene.views[0].camera
    intrinsics = (camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy)
    (folder / "cameras.txt").write_text(" ".join(map(str, (1, "PINHOLE", *intrinsics))) + "\n")
    lines, tracks = [], [""] * len(scene.points)
    for number, view in enumerate(scene.views, start=1):
        pose = view.camera.world_to_camera if poses is None else poses(view.camera.world_to_camera)
        x, y, z, w = pycolmap.Rigid3d(pose[:3]).rotation.quat
        words = (number, w, x, y, z, *pose[:3, 3], 1, view.path.name)
        lines.append(" ".join(map(str, words)))
        pixels, depths = view.camera.project(scene.points.positions)
        shown = (depths > 0) & (pixels > 0).all(axis=1) & (pixels < intrinsics[:2]).all(axis=1)
        keypoints = [f"{x} {y} {i + 1}" for i, (x, y) in enumerate(pixels) if shown[i]]
        for place, i in enumerate(np.flatnonzero(shown)):
            tracks[i] += f" {number} {place}"
        lines += [" ".join(keypoints)] if blank else []
    (folder / "images.txt").write_text("\n".join(lines) + "\n")
    rows = zip(scene.points.positions, scene.points.colours, tracks, strict=True)
    text = [" ".join(map(str, (i, *place, *colour, 0.4))) + track for i, (place, colour, track) in enumerate(rows, 1)]
    (folder / "points3D.txt").write_text("\n".join(text) + "\n")
