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
MENISCUS = 6  # p, even: the share of a puddle's radius that its rim takes is about 1 / p
STEPS = 5  # Newton's, to a meniscus

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

    inverse: Array  # [N, 2, 2], from the base, in mean radii, to the unit disk
    lean: Array  # [N, 2], by how much the body leans over in the pane's plane, a unit of height
    contact: Array  # [N], contact angle, radians, below pi / 2
    meniscus: NDArray[np.bool_]  # [N], not a cap

    def take(self, which: NDArray | slice) -> "Bodies":
        """Those of an index or a slice."""
        return Bodies(self.inverse[which], self.lean[which], self.contact[which], self.meniscus[which])


def enter_water(ray: Array) -> Array:
    """Unit directions [N, 3] behind a pane of parallel sides, of camera rays [N, 2]: x / z and y / z in air."""
    across = ray / (WATER * np.sqrt(1 + dot(ray, ray))[:, None])
    along = np.sqrt(1 - dot(across, across))
    return np.concatenate([across, along[:, None]], axis=1)


def leave_drop(place: Array, ray: Array, bodies: Bodies) -> Exit:
    """Follow rays out of the drops that they entered.

    Args:
        place: [N, 2], where they pass the base, in the unit disk of its body.
        ray: [N, 2], x / z and y / z in front of the pane.
        bodies: of the N drops.
    """
    water = enter_water(ray)
    straight = times(bodies.inverse, water[:, :2] - bodies.lean * water[:, 2:])
    way = np.concatenate([straight, water[:, 2:]], axis=1)
    height, slope = np.empty_like(place[:, 0]), np.empty_like(way)
    for kind, hit in ((bodies.meniscus, hit_meniscus), (~bodies.meniscus, hit_cap)):
        height[kind], slope[kind] = hit(place[kind], way[kind], bodies.contact[kind])
    across = times(bodies.inverse.transpose(0, 2, 1), slope[:, :2])
    normal = np.concatenate([across, slope[:, 2:] - dot(bodies.lean, across)[:, None]], axis=1)
    normal /= np.sqrt(dot(normal, normal))[:, None]
    return Exit(*refract(water, normal), normal, height)


def dot(one: Array, other: Array) -> Array:
    """Scalar products [N] of vectors [N, d]."""
    return np.asarray(np.einsum("ni,ni->n", one, other))


def times(matrices: Array, vectors: Array) -> Array:
    """Products [N, 2] of matrices [N, 2, 2] and vectors [N, 2]."""
    return np.asarray(matrices[:, :, 0] * vectors[:, :1] + matrices[:, :, 1] * vectors[:, 1:])


def hit_cap(place: Array, way: Array, contact: Array) -> tuple[Array, Array]:
    """Height [N] and normal [N, 3], not of unit length, where ways [N, 3] leave caps on the unit disk."""
    depth = 1 / np.tan(contact)  # of the sphere's centre below the pane
    a = dot(way, way)
    b = dot(place, way[:, :2]) + depth * way[:, 2]
    inside = np.minimum(dot(place, place) - 1, 0)
    distance = (np.sqrt(b**2 - a * inside) - b) / a
    height = distance * way[:, 2]
    across = place + distance[:, None] * way[:, :2]
    return height, np.concatenate([across, (height + depth)[:, None]], axis=1)


def hit_meniscus(place: Array, way: Array, contact: Array) -> tuple[Array, Array]:
    """The same for menisci, by Newton's method from the height above the place of entry."""
    rim = np.tan(contact)
    drift = way[:, :2] / way[:, 2:]

    def surface(across: Array) -> tuple[Array, Array]:
        inner = dot(across, across) ** (MENISCUS // 2 - 1)  # rho^(p - 2)
        return rim / MENISCUS * (1 - inner * dot(across, across)), (rim * inner)[:, None] * across

    height, _ = surface(place)
    for _ in range(STEPS):
        across = place + height[:, None] * drift
        top, slope = surface(across)
        height = height - (height - top) / (1 + dot(slope, drift))
    _, slope = surface(place + height[:, None] * drift)
    return height, np.concatenate([slope, np.ones_like(height)[:, None]], axis=1)


def refract(incident: Array, normal: Array) -> tuple[Array, Array]:
    """Unit directions [N, 3] in air and the share of light [N] that passes, out of water.

    Args:
        incident: [N, 3], unit, in water.
        normal: [N, 3], unit, into the air.
    """
    cosine = dot(incident, normal)
    square = 1 - WATER**2 * (1 - cosine**2)  # of the cosine in air
    total = (square < 0) | (cosine <= 0)
    out = np.sqrt(np.where(total, 0, square))
    direction = WATER * incident + (out - WATER * cosine)[:, None] * normal
    with np.errstate(divide="ignore", invalid="ignore"):
        upright = (WATER * cosine - out) / (WATER * cosine + out)
        level = (WATER * out - cosine) / (WATER * out + cosine)
    passing = np.where(total, 0, 1 - (upright**2 + level**2) / 2)
    return np.where(total[:, None], np.nan, direction), passing.astype(incident.dtype)
