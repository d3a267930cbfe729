"""Water drops on a lens: where they sit and what shape they have.

The lens is the plane z = 1 in front of a camera at the origin with OpenCV axes (x right, y down, z forward),
so that lengths on it are pixels divided by the focal length. Gravity acts along +y.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hydroviews.blender.meshes import Mesh, joined

Array = NDArray[np.float64]
GAP = 1.15  # neighbouring drops are at least this many times the sum of their radii apart
LONGEST = 1.35  # the most that gravity stretches a drop


@dataclass(frozen=True)
class Drop:
    """One drop; lengths in units of the lens's distance."""

    x: float
    y: float
    radius: float
    contact_angle: float  # radians, between the lens and the water's surface at the rim
    stretch: float  # length along gravity over width
    sag: float  # how far the belly hangs below the middle, in radii
    outline: tuple[tuple[float, float], ...]  # amplitude and phase of the rim's waves of 2, 3, ... periods


def place(
    rng: np.random.Generator, radii: Array, low: Array, high: Array, tries: int = 30
) -> tuple[Array, NDArray[np.bool_]]:
    """Places [N, 2] between the corners `low` and `high` such that no two drops touch, and which found one.

    Large drops are placed first; one that finds no room after `tries` random places is left out.
    """
    places, placed = np.zeros((len(radii), 2)), np.zeros(len(radii), bool)
    for i in np.argsort(-radii, kind="stable"):
        for candidate in rng.uniform(low, high, (tries, 2)):
            room = np.linalg.norm(places[placed] - candidate, axis=1) - GAP * (radii[placed] + radii[i])
            if np.all(room > 0):
                places[i], placed[i] = candidate, True
                break
    return places, placed


def cap(drop: Drop) -> Mesh:
    """The curved side: part of a sphere over a wavy rim, its belly pulled down."""
    steps, segments = _resolution(drop)
    share = np.sin(0.5 * np.pi * np.linspace(0.04, 1, steps))[:, None]  # of the way to the rim; rings crowd there
    rim = _rim(drop, segments)
    curvature_radius = drop.radius / np.sin(drop.contact_angle)
    height = np.sqrt(np.maximum(curvature_radius**2 - (share * drop.radius) ** 2, 0))
    height -= curvature_radius * np.cos(drop.contact_angle)
    x = drop.x + share * rim[:, 0]
    y = drop.y + share * rim[:, 1] + drop.sag * drop.radius * (1 - share**2)
    vertices = np.stack([x, y, 1 + np.broadcast_to(np.maximum(height, 0), x.shape)], -1).reshape(-1, 3)
    faces: list[tuple[int, ...]] = [tuple(range(segments))]
    for ring in range(steps - 1):
        inner, outer = ring * segments, (ring + 1) * segments
        for j in range(segments):
            k = (j + 1) % segments
            faces.append((inner + j, outer + j, outer + k, inner + k))
    return Mesh(vertices, faces, smooth=True)


def base(drop: Drop) -> Mesh:
    """The flat side on the lens, facing the camera."""
    _, segments = _resolution(drop)
    rim = _rim(drop, segments) + np.array([drop.x, drop.y])
    return Mesh(np.column_stack([rim, np.ones(segments)]), [tuple(range(segments - 1, -1, -1))])


def drop_meshes(drops: list[Drop]) -> tuple[Mesh, Mesh]:
    """All curved sides, and all flat ones: two meshes, because only the former are shaded smoothly."""
    return joined(*map(cap, drops)), joined(*map(base, drops))


def _resolution(drop: Drop) -> tuple[int, int]:
    """Rings and segments; droplets of a few pixels need few."""
    return (24, 72) if drop.radius > 0.015 else (10, 32)


def _rim(drop: Drop, segments: int) -> Array:
    """The outline [segments, 2] around the drop's middle: wavy, stretched along y, and narrower above than below."""
    angle = np.linspace(0, 2 * np.pi, segments, endpoint=False)
    radius = np.full(segments, drop.radius)
    for k, (amplitude, phase) in enumerate(drop.outline, start=2):
        radius += drop.radius * amplitude * np.cos(k * angle + phase)
    x, y = radius * np.cos(angle), radius * np.sin(angle)
    narrowing = 1 + 0.5 * (drop.stretch - 1) * y / drop.radius
    return np.column_stack([x * narrowing, y * drop.stretch])
