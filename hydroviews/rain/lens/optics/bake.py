"""Light through the water on a lens: a matte that Blender bakes once, or a picture that it traces."""

import json
import tempfile
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hydroviews.blender.process import run_blender
from hydroviews.rain.lens.optics.mesh import WaterMesh, lens_side, water_mesh
from hydroviews.rain.lens.optics.own_light import SkyEdge
from hydroviews.rain.lens.optics.path_matte import PathMatte, assemble, dry
from hydroviews.rain.lens.patterns.pattern import Focus, RaindropPattern
from hydroviews.rain.lens.patterns.water import Water, water_at
from hydroviews.rain.lens.patterns.window import WindowPattern
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import Image

VERSION = 2  # raised whenever the same pattern gives another matte
FINE_PIXELS = 3_000_000  # about as many light paths as a pass follows
MOST_PATHS = 8  # along a side of a pixel
ACCURATE_PATHS = 576  # a pixel, that the accurate matte wants
MOST_PASSES = 24  # so many bakes it may take: large pictures get fewer paths, for memory's sake
LIGHTING = ("kind", "mist_blur", "own_light", "bright", "dark", "uneven", "tilt", "tilt_direction")  # of windows
COMPOSITED = ("mist", "air", "renewed", *LIGHTING)  # what a pattern says that no matte depends on


def bake_matte(
    pattern: RaindropPattern,
    camera: Camera,
    folder: Path,
    frame: int = 0,
    paths: int | None = None,
    passes: int | None = None,
) -> PathMatte:
    """The matte of a pattern's key frame, kept in `folder` and read from there if it fits.

    With the renderer "aperture" every path starts at its own point of the camera's aperture, and several independent
    bakes are added up; otherwise paths start at a pinhole, and what they show is blurred by the aperture's disk.

    Args:
        pattern: the rain.
        camera: its size and intrinsics; the pose means nothing.
        folder: gets `matte-<frame>.npz` and Blender's log.
        frame: 0 to `pattern.key_frames` - 1.
        paths: k, to follow k x k light paths a pixel instead of `paths_per_side`; more are slower and less noisy.
        passes: how often, instead of once and, with an aperture, `accurate_passes` times.

    Raises:
        InputError: Blender failed (see `process.run_blender`), or the kept matte is damaged.
    """
    paths = paths or paths_per_side(camera)
    aperture = pattern.lens_renderer == "aperture"
    passes = passes or (accurate_passes(paths) if aperture else 1)
    kept = folder / f"matte-{frame}.npz"
    key = _key(pattern, camera, [frame, paths, passes])
    if kept.exists():
        matte, kept_key = PathMatte.load(kept)
        if kept_key == key:
            return matte
    mesh = lens_water(pattern, camera, frame)
    if len(mesh.caps) == 0:
        matte = dry(camera.height, camera.width, window=isinstance(pattern, WindowPattern))
    else:
        disk = focus_disk(pattern, camera)
        opening = aperture_radius(disk, camera) if aperture else 0.0
        blurred = 0.0 if aperture or pattern.focus == "drops" else disk
        matte = bake(mesh, camera, folder, paths, passes, opening, blurred, pattern.focus, sky_edge(pattern, camera))
    matte.save(kept, key)
    return matte


def bake(
    mesh: WaterMesh,
    camera: Camera,
    folder: Path,
    paths: int,
    passes: int = 1,
    aperture: float = 0.0,
    disk: float = 0.0,
    focus: Focus = "scene",
    sky: SkyEdge | None = None,
) -> PathMatte:
    """The matte of any water, from the paths of `bake_paths`, its drops blurred by a disk of so many pixels."""
    traced = bake_paths(mesh, camera, folder, paths, passes, aperture, focus)
    bright = None if sky is None else sky.plane(traced)
    return assemble(traced["cover"], traced["pixel"], traced["place"], traced["throughput"], disk, bright)


def bake_paths(
    mesh: WaterMesh,
    camera: Camera,
    folder: Path,
    paths: int,
    passes: int = 1,
    aperture: float = 0.0,
    focus: Focus = "scene",
) -> dict[str, Any]:
    """Light paths through any water: k x k a pixel, so many times; `aperture` as a radius in lens distances.

    Returns:
        `cover`, `pixel`, `place` and `throughput`, as `path_matte.assemble` takes them.

    Raises:
        InputError: Blender failed (see `process.run_blender`).
    """
    task = {"paths": paths, "passes": passes, "aperture": aperture, "focus": focus}
    return _run("bake_drops", mesh, camera, task, folder, "raindrops")


def trace(
    mesh: WaterMesh,
    camera: Camera,
    picture: Image,
    samples: int,
    folder: Path,
    aperture: float = 0.0,
    seed: int = 0,
    focus: Focus = "scene",
) -> tuple[NDArray[np.float32], float]:
    """What mattes approximate, by full path tracing with depth of field.

    Args:
        mesh: the water.
        camera: its size and intrinsics; the pose means nothing.
        picture: [H, W, 3], linear light.
        samples: paths a pixel.
        folder: gets Blender's log.
        aperture: its radius in lens distances.
        seed: of the paths.
        focus: on the picture or on the lens.

    Returns:
        [H, W, 4]: linear radiance of the drops, and their cover; and the CPU seconds of rendering alone.

    Raises:
        InputError: Blender failed (see `process.run_blender`).
    """
    light = np.asarray(picture, np.float32)
    task = {"samples": samples, "picture": light, "aperture": aperture, "seed": seed, "focus": focus}
    traced = _run("trace_drops", mesh, camera, task, folder, "tracing drops")
    return traced["light"], float(traced["seconds"])


def _run(
    module: str, mesh: WaterMesh, camera: Camera, task: dict[str, Any], folder: Path, label: str
) -> dict[str, Any]:
    """Run a Blender process on water, a camera and a task, whose arrays go through files; what it wrote."""
    with tempfile.TemporaryDirectory(prefix="hydroviews-") as scratch:
        arrays = {name: value for name, value in task.items() if isinstance(value, np.ndarray)}
        np.savez(Path(scratch) / "input.npz", **asdict(mesh), **arrays)
        request = {name: value for name, value in task.items() if name not in arrays}
        files = {"input": str(Path(scratch) / "input.npz"), "output": str(Path(scratch) / "output.npz")}
        run_blender(module, request | files | {"camera": intrinsics(camera)}, folder / "blender.log", label)
        with np.load(files["output"]) as output:
            return dict(output)


def lens_water(pattern: RaindropPattern, camera: Camera, frame: int) -> WaterMesh:
    """The water of a key frame in front of a camera."""
    return water_mesh(water_of(pattern, camera, frame), pattern.capillary_length, camera)


def water_of(pattern: RaindropPattern, camera: Camera, frame: int) -> Water:
    """The water of a key frame on a lens of this camera's shape."""
    side = lens_side(camera)
    return water_at(pattern, (camera.width / side, camera.height / side), moment_of(pattern, frame))


def sky_edge(pattern: RaindropPattern, camera: Camera) -> SkyEdge | None:
    """The edge of the bright part in a pane's drops; None for drops that show the scene alone."""
    return SkyEdge.of(pattern, camera) if isinstance(pattern, WindowPattern) else None


def moment_of(pattern: RaindropPattern, frame: int) -> float:
    """When in the sequence of key frames one is, 0 to 1."""
    return frame / max(pattern.key_frames - 1, 1)


def intrinsics(camera: Camera) -> dict[str, Any]:
    """The camera at the origin, as JSON: drops on the lens do not care where it is."""
    return {**asdict(camera), "world_to_camera": np.eye(4).tolist()}


def _key(pattern: RaindropPattern, camera: Camera, rest: list[int]) -> str:
    drawn = {name: value for name, value in asdict(pattern).items() if name not in COMPOSITED}
    return json.dumps([VERSION, drawn, intrinsics(camera), rest])


def paths_per_side(camera: Camera) -> int:
    """k, for k x k light paths a pixel: 5 at 400 x 300, between 2 for large pictures and 8 for small ones."""
    return int(np.clip(np.sqrt(FINE_PIXELS / (camera.width * camera.height)), 2, MOST_PATHS))


def accurate_passes(paths: int) -> int:
    """How many bakes of k x k paths a pixel the accurate matte adds up."""
    return int(np.clip(np.ceil(ACCURATE_PATHS / paths**2), 1, MOST_PASSES))


def focus_disk(pattern: RaindropPattern, camera: Camera) -> float:
    """Diameter of the defocus disk in pixels."""
    return pattern.focus_blur * lens_side(camera)


def aperture_radius(disk: float, camera: Camera) -> float:
    """Radius of the aperture, in lens distances, that draws a point out of focus as a disk of this many pixels.

    A thin lens of diameter A, focused far away, draws a point of a pane at distance d as a disk of the angle A / d;
    focused on the pane, it draws a point far away as a disk of the angle A (1 / d - 1 / infinity), which is the same.
    """
    return disk / (2 * float(np.sqrt(camera.fx * camera.fy)))
