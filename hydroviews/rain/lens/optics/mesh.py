"""The water on a lens as triangles in space, for Blender.

The lens is the plane z = 1 in front of a camera at the origin with OpenCV axes (x right, y down, z forward), so that
lengths on it are pixels divided by the focal length.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hydroviews.rain.lens.optics.drop_surface import water_surface
from hydroviews.rain.lens.patterns.beads import Beads
from hydroviews.rain.lens.patterns.shapes import Patch, drop_patch, ribbon, star
from hydroviews.rain.lens.patterns.water import Drop, Water
from hydroviews.scene.cameras import Camera

Array = NDArray[np.float64]
RESOLUTIONS = ((0.01, 24, 6), (0.018, 32, 8), (0.035, 48, 12), (np.inf, 72, 18))  # up to a radius: segments, rings
DROPLET = (10, 3)  # segments and rings of a drop of a few pixels
BEAD_SIZES = ((0.004, 16, 4), (np.inf, 28, 6))  # up to a radius: segments and rings of a bead
SAGGING = 0.5  # how much narrower above than below a bead is that is higher than wide


@dataclass(frozen=True, eq=False)
class WaterMesh:
    """Closed bodies of water: their curved and flat sides share the vertices of the rims in place, not in number."""

    vertices: NDArray[np.float32]  # [N, 3]
    caps: NDArray[np.int32]  # [T, 3], curved, facing away from the camera
    bases: NDArray[np.int32]  # [T, 3], flat on the lens, facing the camera


def lens_side(camera: Camera) -> float:
    """Pixels in a side: the geometric mean of width and height."""
    return float(np.sqrt(camera.width * camera.height))


def water_mesh(water: Water, capillary_length: float, camera: Camera) -> WaterMesh:
    """Triangles of all the water in front of a camera.

    Args:
        water: lengths in sides.
        capillary_length: in sides.
        camera: its size and intrinsics; the pose means nothing.
    """
    patches = [drop_to_patch(drop) for drop in water.drops]
    patches += [ribbon(*rivulet.ribbon, rivulet.contact_angle) for rivulet in water.rivulets]
    patches = [_on_lens(patch, camera) for patch in patches]
    surfaces = list(zip(*water_surface(patches, capillary_length * _scale(camera)), strict=True))
    surfaces += [(_on_lens(patch, camera), height * _scale(camera)) for patch, height in map(_droplet, water.droplets)]
    for low, (high, segments, rings) in zip((0.0, *(size[0] for size in BEAD_SIZES)), BEAD_SIZES, strict=False):
        some = water.beads[(water.beads.radii > low) & (water.beads.radii <= high)]
        if len(some):
            patch, height = _beads(some, segments, rings)
            surfaces.append((_on_lens(patch, camera), height * _scale(camera)))
    return solid(surfaces)


def solid(surfaces: list[tuple[Patch, Array]]) -> WaterMesh:
    """Bodies of water from patches of the lens and the heights [N] above their vertices."""
    vertices, caps, bases, start = [np.zeros((0, 3))], [np.zeros((0, 3), int)], [np.zeros((0, 3), int)], 0
    for patch, height in surfaces:
        count = len(patch.vertices)
        vertices += [np.column_stack([patch.vertices, 1 + h]) for h in (height, np.zeros(count))]
        caps.append(patch.triangles + start)
        bases.append(patch.triangles[:, ::-1] + start + count)
        start += 2 * count
    faces = [np.concatenate(parts).astype(np.int32) for parts in (caps, bases)]
    return WaterMesh(np.concatenate(vertices).astype(np.float32), *faces)


def drop_to_patch(drop: Drop) -> Patch:
    """Its outline, finer for larger drops."""
    segments, rings = next((s, r) for limit, s, r in RESOLUTIONS if drop.outline.radius <= limit)
    return drop_patch(drop.outline, drop.contact_angle, segments, rings)


def _droplet(droplet: Array) -> tuple[Patch, Array]:
    """A round drop so small that gravity does not matter: part of a sphere."""
    x, y, radius, angle = droplet.tolist()
    segments, rings = DROPLET
    turn = np.linspace(0, 2 * np.pi, segments, endpoint=False)
    middle = np.array([x, y])
    patch = star(middle, middle + radius * np.column_stack([np.cos(turn), np.sin(turn)]), rings, angle)
    curvature = radius / np.sin(angle)
    share = np.linalg.norm(patch.vertices - middle, axis=1)
    height = np.sqrt(np.maximum(curvature**2 - share**2, 0)) - curvature * np.cos(angle)
    return patch, np.where(patch.rim, 0, np.maximum(height, 0))


def _beads(beads: Beads, segments: int, rings: int) -> tuple[Patch, Array]:
    """All of some beads as one patch: spheres' caps, each drawn out to its outline."""
    turn = np.linspace(0, 2 * np.pi, segments, endpoint=False)
    one = star(np.zeros(2), np.column_stack([np.cos(turn), np.sin(turn)]), rings, contact_angle=1.0)
    share = np.linalg.norm(one.vertices, axis=1)  # 0 in the middle, 1 at the rim
    angle = np.arctan2(one.vertices[:, 1], one.vertices[:, 0])
    periods = np.arange(2, 2 + beads.waves.shape[1])
    waves = beads.waves[..., 0, None] * np.cos(periods[:, None] * angle + beads.waves[..., 1, None])
    reach = beads.radii[:, None] * share * np.clip(1 + waves.sum(axis=1), 0.5, 1.6)
    across, down = reach * np.cos(angle), reach * np.sin(angle)
    sag = SAGGING * np.clip(1 / beads.aspects - 1, 0, 1)[:, None]
    across *= np.sqrt(beads.aspects)[:, None] * (1 + sag * down / beads.radii[:, None])
    down /= np.sqrt(beads.aspects)[:, None]
    curvature = (beads.radii / np.sin(beads.angles))[:, None]
    height = np.sqrt(np.maximum(curvature**2 - (share * beads.radii[:, None]) ** 2, 0))
    height = np.maximum(height - curvature * np.cos(beads.angles)[:, None], 0) * ~one.rim
    vertices = beads.places[:, None] + np.stack([across, down], axis=-1)
    first = len(one.vertices) * np.arange(len(beads))[:, None, None]
    rim = np.tile(one.rim, len(beads))
    return Patch(vertices.reshape(-1, 2), (one.triangles + first).reshape(-1, 3), rim, 1.0), height.ravel()


def _on_lens(patch: Patch, camera: Camera) -> Patch:
    """The patch in units of the lens's distance."""
    focal, centre = np.array([camera.fx, camera.fy]), np.array([camera.cx, camera.cy])
    vertices = (patch.vertices * lens_side(camera) - centre) / focal
    return replace(patch, vertices=vertices, radius=None if patch.radius is None else patch.radius * _scale(camera))


def _scale(camera: Camera) -> float:
    """Lens distances in a side."""
    return lens_side(camera) / float(np.sqrt(camera.fx * camera.fy))
