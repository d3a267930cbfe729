"""The embedded scenes as captures: rendered once into a folder, then read like any other."""

from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from hydroviews.blender.embedded_scenes.camera_paths import place_cameras
from hydroviews.blender.embedded_scenes.embedded import DESIGNS
from hydroviews.blender.process import run_blender
from hydroviews.errors import InputError
from hydroviews.files.atomic import read_json, write_json
from hydroviews.scene.cameras import Camera
from hydroviews.scene.scenes import Points, Scene, View, make_scene

VERSION = 2  # raised whenever the same request gives other files
EMBEDDED = tuple(DESIGNS)


def render_embedded(name: str, folder: Path, n_views: int, width: int, height: int, seed: int) -> None:
    """Write the capture of an embedded scene.

    The folder gets `images/000.png` onwards, `depth/000.exr` onwards (channel Z: metres along the optical axis at
    each pixel's centre, infinite in the sky), `points.npz`, and `cameras.json` when all else is there. World units
    are metres. The same arguments give the same pixels. An interrupted call goes on with the views that are missing;
    other arguments start over.

    Raises:
        InputError: no such scene, too few views, an empty image, a negative seed, or Blender failed (see
            `process.run_blender`).
    """
    if name not in DESIGNS:
        raise InputError(f"{name}: no such embedded scene", expected=f"one of {', '.join(EMBEDDED)}")
    if n_views < 3 or width < 1 or height < 1 or seed < 0:
        raise InputError(
            f"{folder}: cannot render this {name}",
            found=f"{n_views} views of {width}x{height} pixels, seed {seed}",
            expected="at least three views, at least one pixel, and a seed of 0 or more",
        )
    request = {
        "version": VERSION,
        "scene": name,
        "n_views": n_views,
        "width": width,
        "height": height,
        "seed": seed,
    }
    if _finished(folder, request):
        return
    started = folder / "request.json"
    if not started.exists() or read_json(started) != request:
        _clear(folder)
        write_json(started, request)
    cameras = place_cameras(DESIGNS[name].path, n_views, width, height, seed)
    views = [{"name": view, **_record(camera)} for view, camera in zip(_names(n_views), cameras, strict=True)]
    task = {"scene": name, "folder": str(folder), "seed": seed, "views": views}
    run_blender("render_views", task, folder / "blender.log", name)
    write_json(folder / "cameras.json", {"request": request, "metres_per_unit": 1.0, "views": views})


def read_embedded(name: str, folder: Path) -> Scene:
    """The rendered capture as a scene of that name.

    Raises:
        InputError: it was not rendered, or not to the end.
    """
    if not (folder / "cameras.json").exists():
        raise InputError(
            f"{folder}: not a finished capture of {name}",
            found="no cameras.json",
            fix="render it; what is there already is kept",
        )
    kept = read_json(folder / "cameras.json")
    with np.load(folder / "points.npz") as points:
        cloud = Points(points["positions"], points["colours"])
    scene = make_scene(name, [_view(folder, **view) for view in kept["views"]], cloud)
    design = DESIGNS[name]
    return replace(
        scene,
        metres_per_unit=kept["metres_per_unit"],
        clean_error=design.clean_error,
        drops_cost=design.drops_cost,
    )


def _names(n_views: int) -> list[str]:
    """Names that sort like the numbers they are."""
    digits = max(3, len(str(n_views - 1)))
    return [f"{i:0{digits}d}" for i in range(n_views)]


def _view(folder: Path, name: str, **camera: Any) -> View:
    return View(name, Camera(**camera), folder / "images" / f"{name}.png")


def _record(camera: Camera) -> dict[str, Any]:
    return {**asdict(camera), "world_to_camera": camera.world_to_camera.tolist()}


def _finished(folder: Path, request: dict[str, Any]) -> bool:
    cameras = folder / "cameras.json"
    return (
        cameras.exists()
        and read_json(cameras)["request"] == request
        and (folder / "points.npz").exists()
        and all(file.exists() for name in _names(request["n_views"]) for file in _files(folder, name))
    )


def _files(folder: Path, name: str) -> tuple[Path, Path]:
    return folder / "images" / f"{name}.png", folder / "depth" / f"{name}.exr"


def _clear(folder: Path) -> None:
    """Remove what an earlier request left; only files of the names that are written here."""
    numbered = [*folder.glob("images/[0-9][0-9][0-9]*.png"), *folder.glob("depth/[0-9][0-9][0-9]*.exr")]
    for path in [folder / "cameras.json", folder / "points.npz", *numbered]:
        path.unlink(missing_ok=True)
