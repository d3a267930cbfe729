"""Drops on the lens: drawn from a pattern's parameters, baked by Blender once, applied to any view."""

import json
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hydroviews.blender.drop_shapes import LONGEST, Drop, place
from hydroviews.blender.process import run_blender
from hydroviews.cameras import Camera
from hydroviews.images import Image
from hydroviews.rain.path_matte import PathMatte, assemble, dry

VERSION = 1  # raised whenever the same pattern gives another matte
MARGIN = 0.05  # drops may sit this far beyond the picture's edge, in picture sides
FINE_PIXELS = 8_000_000  # about as many light paths as a bake follows


@dataclass(frozen=True)
class RaindropPattern:
    """Parameters of drops on a lens; "side" is the geometric mean of the picture's width and height."""

    coverage: float  # share of the picture that large drops cover, as far as they find room
    radius_median: float  # of the large drops, in sides
    radius_spread: float  # standard deviation of the radius's logarithm
    droplets: int  # number of tiny drops between the large ones
    contact_angle_min: float  # degrees
    contact_angle_max: float
    sag: float  # pull of gravity on large drops, 0 to 1
    focus_blur: float  # diameter of the defocus disk, in sides
    seed: int  # of the drops' places and shapes


def draw_pattern(rng: np.random.Generator) -> RaindropPattern:
    """Draw the parameters of a lens in rain: large drops cover 8 to 20 % of it."""
    return RaindropPattern(
        coverage=float(rng.uniform(0.08, 0.2)),
        radius_median=float(rng.uniform(0.018, 0.034)),
        radius_spread=float(rng.uniform(0.4, 0.6)),
        droplets=int(rng.integers(80, 260)),
        contact_angle_min=float(rng.uniform(28, 38)),
        contact_angle_max=float(rng.uniform(43, 54)),
        sag=float(rng.uniform(0.3, 1.0)),
        focus_blur=float(rng.uniform(0.004, 0.012)),
        seed=int(rng.integers(2**31)),
    )


def bake_matte(pattern: RaindropPattern, camera: Camera, folder: Path, paths: int | None = None) -> PathMatte:
    """The matte of a pattern for a camera's size and intrinsics, kept in `folder` and read from there if it fits.

    Args:
        pattern: the drops.
        camera: its size and intrinsics; the pose means nothing.
        folder: gets `matte.npz` and Blender's log.
        paths: k, to follow k x k light paths a pixel instead of `paths_per_side`; more are slower and less noisy.

    Raises:
        InputError: Blender failed (see `process.run_blender`), or the kept matte is damaged.
    """
    paths = paths or paths_per_side(camera)
    kept, key = folder / "matte.npz", json.dumps([VERSION, asdict(pattern), _intrinsics(camera), paths])
    if kept.exists():
        matte, kept_key = PathMatte.load(kept)
        if kept_key == key:
            return matte
    drops = draw_drops(pattern, camera)
    if drops:
        matte = _bake(drops, camera, paths, focus_disk(pattern, camera), folder)
    else:
        matte = dry(camera.height, camera.width)
    matte.save(kept, key)
    return matte


def trace_drops(
    pattern: RaindropPattern, camera: Camera, picture: Image, samples: int, folder: Path
) -> NDArray[np.float32]:
    """What the matte approximates, by full path tracing in focus: slow, for tests and comparisons.

    Args:
        pattern: the drops.
        camera: its size and intrinsics; the pose means nothing.
        picture: [H, W, 3], linear light.
        samples: paths a pixel.
        folder: gets Blender's log.

    Returns:
        [H, W, 4]: linear radiance of the drops, and their cover.
    """
    with tempfile.TemporaryDirectory(prefix="hydroviews-") as scratch:
        source, output = Path(scratch) / "picture.npy", Path(scratch) / "drops.npy"
        np.save(source, picture)
        task = {"samples": samples, "picture": str(source)}
        request = _request(draw_drops(pattern, camera), camera, output) | task
        run_blender("trace_drops", request, folder / "blender.log", "tracing drops")
        return np.load(output)


def _bake(drops: list[Drop], camera: Camera, paths: int, disk: float, folder: Path) -> PathMatte:
    with tempfile.TemporaryDirectory(prefix="hydroviews-") as scratch:
        output = Path(scratch) / "paths.npz"
        request = _request(drops, camera, output) | {"paths": paths}
        run_blender("bake_drops", request, folder / "blender.log", "raindrops")
        with np.load(output) as traced:
            return assemble(traced["cover"], traced["pixel"], traced["place"], traced["throughput"], disk)


def _request(drops: list[Drop], camera: Camera, output: Path) -> dict[str, Any]:
    return {"drops": [asdict(drop) for drop in drops], "camera": _intrinsics(camera), "output": str(output)}


def _intrinsics(camera: Camera) -> dict[str, Any]:
    """The camera at the origin, as JSON: drops on the lens do not care where it is."""
    return {**asdict(camera), "world_to_camera": np.eye(4).tolist()}


def paths_per_side(camera: Camera) -> int:
    """k, for k x k light paths a pixel: 6, and fewer from a quarter of a megapixel on, but at least 2."""
    return int(np.clip(np.sqrt(FINE_PIXELS / (camera.width * camera.height)), 2, 6))


def focus_disk(pattern: RaindropPattern, camera: Camera) -> float:
    """Diameter of the defocus disk in pixels."""
    return pattern.focus_blur * _side(camera)


def _side(camera: Camera) -> float:
    return float(np.sqrt(camera.width * camera.height))


def draw_drops(pattern: RaindropPattern, camera: Camera) -> list[Drop]:
    """The pattern's drops on the lens of a camera, in units of the lens's distance."""
    rng = np.random.default_rng(pattern.seed)
    large, tiny = _radii(pattern, rng), 0.001 * rng.uniform(3, 9, pattern.droplets)
    radii = np.concatenate([large, tiny])
    sides = np.array([camera.width, camera.height]) / _side(camera)
    places, placed = place(rng, radii * np.sqrt(LONGEST), -MARGIN * sides, (1 + MARGIN) * sides)
    focal, centre = np.array([camera.fx, camera.fy]), np.array([camera.cx, camera.cy])
    drops = []
    for i in np.flatnonzero(placed):
        x, y = (places[i] * _side(camera) - centre) / focal
        radius = radii[i] * _side(camera) / np.sqrt(camera.fx * camera.fy)
        drops.append(_draw_drop(pattern, rng, (float(x), float(y)), float(radius), heavy=i < len(large)))
    return drops


def _radii(pattern: RaindropPattern, rng: np.random.Generator) -> NDArray[np.float64]:
    """Radii in sides whose disks cover the wanted share of the picture with its margin."""
    if pattern.coverage <= 0:
        return np.zeros(0)
    wanted = pattern.coverage * (1 + 2 * MARGIN) ** 2
    at_most = int(np.ceil(wanted / (np.pi * pattern.radius_median**2))) * 4 + 8
    radii = pattern.radius_median * np.exp(pattern.radius_spread * rng.standard_normal(at_most))
    radii = np.clip(radii, 0.3 * pattern.radius_median, 3.5 * pattern.radius_median)
    return radii[: 1 + int(np.searchsorted(np.cumsum(np.pi * radii**2), wanted))]


def _draw_drop(
    pattern: RaindropPattern, rng: np.random.Generator, at: tuple[float, float], radius: float, heavy: bool
) -> Drop:
    pull = pattern.sag if heavy else 0.2 * pattern.sag
    stretch = 1 + (LONGEST - 1) * pull * rng.uniform(0.3, 1)
    waves = 0.06 * rng.standard_normal(4) / np.arange(1, 5) ** 1.3
    angle = np.radians(rng.uniform(pattern.contact_angle_min, pattern.contact_angle_max))
    outline = tuple(zip(waves.tolist(), rng.uniform(0, 2 * np.pi, 4).tolist(), strict=True))
    # A stretched drop keeps its area.
    return Drop(*at, radius / np.sqrt(stretch), float(angle), float(stretch), float(0.6 * (stretch - 1)), outline)
