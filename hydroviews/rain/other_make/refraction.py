"""What a drop on a pane in front of the lens shows: rays from the camera, through water, out into the scene.

The pane is perpendicular to the optical axis and so near that the scene is far away from it: a ray matters by its
direction alone. The drop sits on the outer side. A ray enters it through its flat base and leaves it through its
surface, by Snell's law in vectors (Glassner 1989, p. 137) and Fresnel's equations for unpolarised light.

A drop is the linear image of a body on the unit disk: stretched in its plane, and leaning. Bodies are

* a cap: the part of a sphere that meets the pane at the contact angle, for drops that gravity does not flatten;
* a meniscus: z = (1 - rho^p) tan(angle) / p, flat in the middle and steep at the rim, as puddles higher than the
  capillary length allows are (de Gennes, Brochard-Wyart and Quere 2004, chapter 2).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

WATER = 1.333  # refractive index
MENISCUS = 6  # p: the share of a puddle's radius that its rim takes is about 1 / p
STEPS = 6  # Newton's, to a meniscus; the error is below 1e-6 radii

Array = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class Exit:
    """Where rays leave drops."""

    direction: Array  # [N, 3], unit, into the scene; not a number where all light is reflected
    passing: Array  # [N], share of the light that passes the surface, 0 where all of it is reflected
    normal: Array  # [N, 3], unit, outward
    height: Array  # [N], above the pane, in base radii


@dataclass(frozen=True, eq=False)
class Bodies:
    """The shape of the drop that each of N rays goes through."""

    stretch: Array  # [N, 2, 2], from the unit disk to the base, in mean radii
    lean: Array  # [N, 2], by how much the body leans over in the pane's plane, a unit of height
    contact: Array  # [N], contact angle, radians, below pi / 2
    meniscus: NDArray[np.bool_]  # [N], not a cap


def enter_water(ray: Array) -> Array:
    """Unit directions [N, 3] behind a pane of parallel sides, of camera rays [N, 2]: x / z and y / z in air."""
    across = ray / (WATER * np.sqrt(1 + (ray**2).sum(axis=1, keepdims=True)))
    along = np.sqrt(1 - (across**2).sum(axis=1, keepdims=True))
    return np.concatenate([across, along], axis=1)


def leave_drop(place: Array, ray: Array, bodies: Bodies) -> Exit:
    """Follow rays out of the drops that they entered.

    Args:
        place: [N, 2], where they pass the base, in the unit disk of its body.
        ray: [N, 2], x / z and y / z in front of the pane.
        bodies: of the N drops.
    """
    water = enter_water(ray)
    inverse = np.linalg.inv(bodies.stretch)
    straight = np.einsum("nij,nj->ni", inverse, water[:, :2] - bodies.lean * water[:, 2:])
    way = np.concatenate([straight, water[:, 2:]], axis=1)
    height, slope = np.empty_like(place[:, 0]), np.empty_like(way)
    for kind, hit in ((bodies.meniscus, hit_meniscus), (~bodies.meniscus, hit_cap)):
        height[kind], slope[kind] = hit(place[kind], way[kind], bodies.contact[kind])
    across = np.einsum("nji,nj->ni", inverse, slope[:, :2])
    normal = np.concatenate([across, slope[:, 2:] - (bodies.lean * across).sum(axis=1, keepdims=True)], axis=1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return Exit(*refract(water, normal), normal, height)


def hit_cap(place: Array, way: Array, contact: Array) -> tuple[Array, Array]:
    """Height [N] and normal [N, 3], not of unit length, where ways [N, 3] leave caps on the unit disk."""
    depth = 1 / np.tan(contact)  # of the sphere's centre below the pane
    a = (way**2).sum(axis=1)
    b = (place * way[:, :2]).sum(axis=1) + depth * way[:, 2]
    inside = np.minimum((place**2).sum(axis=1) - 1, 0)
    distance = (np.sqrt(b**2 - a * inside) - b) / a
    height = distance * way[:, 2]
    across = place + distance[:, None] * way[:, :2]
    return height, np.concatenate([across, (height + depth)[:, None]], axis=1)


def hit_meniscus(place: Array, way: Array, contact: Array) -> tuple[Array, Array]:
    """The same for menisci, by Newton's method from the height above the place of entry."""
    rim = np.tan(contact)
    height = rim / MENISCUS * (1 - np.minimum((place**2).sum(axis=1), 1) ** (MENISCUS / 2))
    drift = way[:, :2] / way[:, 2:]
    for _ in range(STEPS):
        across = place + height[:, None] * drift
        square = (across**2).sum(axis=1)
        slope = rim[:, None] * square[:, None] ** (MENISCUS / 2 - 1) * across
        error = height - rim / MENISCUS * (1 - square ** (MENISCUS / 2))
        height = height - error / (1 + (slope * drift).sum(axis=1))
    across = place + height[:, None] * drift
    slope = rim[:, None] * ((across**2).sum(axis=1) ** (MENISCUS / 2 - 1))[:, None] * across
    return height, np.concatenate([slope, np.ones_like(height)[:, None]], axis=1)


def refract(incident: Array, normal: Array) -> tuple[Array, Array]:
    """Unit directions [N, 3] in air and the share of light [N] that passes, out of water.

    Args:
        incident: [N, 3], unit, in water.
        normal: [N, 3], unit, into the air.
    """
    cosine = (incident * normal).sum(axis=1)
    square = 1 - WATER**2 * (1 - cosine**2)  # of the cosine in air
    total = (square < 0) | (cosine <= 0)
    out = np.sqrt(np.where(total, 0, square))
    direction = WATER * incident + (out - WATER * cosine)[:, None] * normal
    with np.errstate(divide="ignore", invalid="ignore"):
        upright = (WATER * cosine - out) / (WATER * cosine + out)
        level = (WATER * out - cosine) / (WATER * out + cosine)
    passing = np.where(total, 0, 1 - (upright**2 + level**2) / 2)
    return np.where(total[:, None], np.nan, direction), passing.astype(incident.dtype)
