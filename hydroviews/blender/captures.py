"""The embedded capture `courtyard`: rendered once into a folder, then read like any other."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from hydroviews.blender.process import run_blender
from hydroviews.cameras import Camera
from hydroviews.errors import InputError
from hydroviews.files import read_json, write_json
from hydroviews.scenes import TEST_EVERY, Points, Scene, View, make_scene

VERSION = 1  # raised whenever the same request gives other pixels
FOCAL = 0.72  # focal length over image width: 70 degrees across
STEP = np.radians(12)  # the widest angle between neighbouring training views
RADIUS, RADIUS_SPREAD = 7.1, 0.5  # metres from the courtyard's centre
HEIGHT, HEIGHT_SPREAD = 2.0, 0.6
TARGET, TARGET_SPREAD = (0.0, 0.0, 1.15), 0.35


def render_courtyard(folder: Path, n_views: int, width: int, height: int, seed: int) -> None:
    """Write the capture: `images/000.png` onwards, `points.npz`, and `cameras.json` when all else is there.

    The same arguments give the same pixels. An interrupted call goes on with the views that are missing;
    other arguments start over.

    Raises:
        InputError: too few views, an empty image, a negative seed, or Blender failed (see `process.run_blender`).
    """
    if n_views < 3 or width < 1 or height < 1 or seed < 0:
        raise InputError(
            f"{folder}: cannot render this courtyard",
            found=f"{n_views} views of {width}x{height} pixels, seed {seed}",
            expected="at least three views, at least one pixel, and a seed of 0 or more",
        )
    request = {"version": VERSION, "n_views": n_views, "width": width, "height": height, "seed": seed}
    if _finished(folder, request):
        return
    started = folder / "request.json"
    if not started.exists() or read_json(started) != request:
        _clear(folder)
        write_json(started, request)
    cameras = ring_cameras(n_views, width, height, seed)
    views = [{"name": name, **_record(camera)} for name, camera in zip(_names(n_views), cameras, strict=True)]
    task = {"folder": str(folder), "seed": seed, "views": views}
    run_blender("render_views", task, folder / "blender.log", "courtyard")
    write_json(folder / "cameras.json", {"request": request, "views": views})


def read_courtyard(folder: Path) -> Scene:
    """The rendered capture as a scene.

    Raises:
        InputError: it was not rendered, or not to the end.
    """
    if not (folder / "cameras.json").exists():
        raise InputError(
            f"{folder}: not a finished courtyard capture",
            found="no cameras.json",
            fix="render it; what is there already is kept",
        )
    views = read_json(folder / "cameras.json")["views"]
    with np.load(folder / "points.npz") as points:
        cloud = Points(points["positions"], points["colours"])
    return make_scene("courtyard", [_view(folder, **view) for view in views], cloud)


def ring_cameras(n_views: int, width: int, height: int, seed: int) -> list[Camera]:
    """Cameras on a wavy ring that look across the courtyard, in order around it.

    Training views are at most 12 degrees apart, so that few views cover only an arc. Each held-out view
    (every 8th) lies midway between two training views that are next to each other, so that it asks for
    interpolation and not for what nobody saw.
    """
    held_out = np.arange(n_views) % TEST_EVERY == 0
    n_train = int((~held_out).sum())
    whole = n_train * STEP >= 2 * np.pi
    step = 2 * np.pi / n_train if whole else STEP
    # In steps along the ring: training views at whole numbers, held-out ones half a step further on.
    place = np.cumsum(~held_out) - 1.0
    place[held_out] += 0.5
    if not whole:  # an arc has ends, and held-out views stay off them
        place[held_out] = np.clip(place[held_out] + 1, 0.5, n_train - 1.5)
    wobble = np.random.default_rng(seed).uniform(-1, 1, (n_train, 4))
    cameras = []
    for at in place:
        low, share = int(np.floor(at)), at - np.floor(at)
        offset = (1 - share) * wobble[low % n_train] + share * wobble[(low + 1) % n_train]
        cameras.append(_camera(at * step, offset, width, height))
    return cameras


def _camera(angle: float, offset: np.ndarray, width: int, height: int) -> Camera:
    radius = RADIUS + RADIUS_SPREAD * (0.5 * offset[0] + 0.5 * np.sin(3 * angle))
    eye_height = HEIGHT + HEIGHT_SPREAD * (0.6 * offset[1] + 0.4 * np.sin(5 * angle))
    eye = np.array([radius * np.cos(angle), radius * np.sin(angle), eye_height])
    target = np.array(TARGET) + TARGET_SPREAD * np.array([offset[2], offset[3], 0.0])
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(forward, right), forward])
    pose[:3, 3] = -pose[:3, :3] @ eye
    focal = FOCAL * width
    return Camera(width, height, focal, focal, width / 2, height / 2, pose)


def _names(n_views: int) -> list[str]:
    """Names that sort like the numbers they are."""
    digits = max(3, len(str(n_views - 1)))
    return [f"{i:0{digits}d}" for i in range(n_views)]


def _view(folder: Path, name: str, **camera: Any) -> View:
    return View(name, Camera(**camera), folder / "images" / f"{name}.png")


def _record(camera: Camera) -> dict[str, Any]:
    return {**asdict(camera), "world_to_camera": camera.world_to_camera.tolist()}


def _finished(folder: Path, request: dict[str, int]) -> bool:
    cameras = folder / "cameras.json"
    return (
        cameras.exists()
        and read_json(cameras)["request"] == request
        and (folder / "points.npz").exists()
        and all((folder / "images" / f"{name}.png").exists() for name in _names(request["n_views"]))
    )


def _clear(folder: Path) -> None:
    """Remove what an earlier request left; only files of the names that are written here."""
    for path in [folder / "cameras.json", folder / "points.npz", *folder.glob("images/[0-9][0-9][0-9]*.png")]:
        path.unlink(missing_ok=True)
