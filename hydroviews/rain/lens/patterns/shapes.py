"""The wet patches of a lens seen from the front: outlines and their triangles, made with numpy alone.

Lengths are in any unit of the plane; x is right, y is down, gravity acts along +y. `drop_surface` gives patches their
height.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
NECK = 0.45  # the least radius of an outline, in radii of its smallest disk
SMOOTHING = 0.16  # radians over which the corners between merged drops are rounded


@dataclass(frozen=True, eq=False)
class Patch:
    """One body of water, triangulated; triangles run anticlockwise where x and y are a right-handed pair."""

    vertices: Array  # [N, 2]
    triangles: NDArray[np.int64]  # [T, 3]
    rim: NDArray[np.bool_]  # [N], where the water ends
    contact_angle: float  # radians, between the lens and the water's surface, the mean along the rim
    radius: float | None = None  # of the round drop that holds as much water; None: whatever fits the outline


@dataclass(frozen=True)
class Outline:
    """A rim that is star-shaped about its middle: disks that have grown together, wavy and pulled down by gravity."""

    disks: tuple[tuple[float, float, float], ...]  # x, y, radius
    stretch: float = 1.0  # length along gravity over width
    waves: tuple[tuple[float, float], ...] = ()  # amplitude and phase of the rim's waves of 2, 3, ... periods

    @property
    def radius(self) -> float:
        """Of the round drop that holds as much water as the disks' drops together."""
        return float(np.cbrt(sum(r**3 for *_, r in self.disks)))

    @property
    def middle(self) -> Array:
        """Centre of mass of the disks' water [2]."""
        disks = np.array(self.disks)
        return np.asarray(np.average(disks[:, :2], axis=0, weights=disks[:, 2] ** 3))


def rim_of(outline: Outline, segments: int) -> Array:
    """The outline's points [segments, 2]."""
    disks, middle = np.array(outline.disks), outline.middle
    angle = np.linspace(0, 2 * np.pi, segments, endpoint=False)
    reach = _reach(disks - [*middle, 0], angle)
    waves = sum(a * np.cos(k * angle + phase) for k, (a, phase) in enumerate(outline.waves, start=2))
    reach = reach * (1 + waves)
    across, down = reach * np.cos(angle), reach * np.sin(angle)
    # Stretched at the same area, and narrower above than below.
    pull = outline.stretch - 1
    narrowing = 1 + 0.5 * pull * np.clip(down / outline.radius, -1, 1)
    points = np.column_stack([across * narrowing / np.sqrt(outline.stretch), down * np.sqrt(outline.stretch)])
    return middle + points


def _reach(disks: Array, angle: Array) -> Array:
    """How far the union of disks [L, 3] around the origin goes in each direction, its corners rounded."""
    if len(disks) == 1:
        return np.full(len(angle), disks[0, 2])
    along = np.cos(angle)[:, None] * disks[:, 0] + np.sin(angle)[:, None] * disks[:, 1]
    square = disks[:, 2] ** 2 - (disks[:, :2] ** 2).sum(axis=1) + along**2
    far = np.where(square >= 0, along + np.sqrt(np.maximum(square, 0)), 0).max(axis=1)
    far = np.maximum(far, NECK * disks[:, 2].min())
    frequency = np.fft.rfftfreq(len(angle), 1 / len(angle))
    return np.fft.irfft(np.fft.rfft(far) * np.exp(-0.5 * (SMOOTHING * frequency) ** 2), len(angle))


def star(middle: Array, rim: Array, rings: int, contact_angle: float, radius: float | None = None) -> Patch:
    """Rings of triangles between a middle [2] and a rim [S, 2] that is seen from it; rings crowd at the rim."""
    segments = len(rim)
    share = np.sin(0.5 * np.pi * np.arange(1, rings + 1) / rings)[:, None, None]
    vertices = np.concatenate([middle[None], (middle + share * (rim - middle)).reshape(-1, 2)])
    j = np.arange(segments)
    k = (j + 1) % segments
    fan = np.column_stack([np.zeros(segments, int), 1 + j, 1 + k])
    inner = 1 + segments * np.arange(rings - 1)[:, None]
    outer = inner + segments
    quads = ((inner + j, outer + j, outer + k), (inner + j, outer + k, inner + k))
    halves = [np.stack(corners, -1).reshape(-1, 3) for corners in quads]
    on_rim = np.zeros(len(vertices), bool)
    on_rim[-segments:] = True
    return Patch(vertices, np.concatenate([fan, *halves]), on_rim, contact_angle, radius)


def ribbon(path: Array, half_widths: Array, contact_angle: float, columns: int = 11) -> Patch:
    """A strip of water along a path [N, 2], `half_widths` [N] wide to either side; it ends at both of its ends."""
    tangent = np.gradient(path, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    normal = np.column_stack([-tangent[:, 1], tangent[:, 0]])
    across = np.sin(0.5 * np.pi * np.linspace(-1, 1, columns))
    vertices = path[:, None] + across[:, None] * (half_widths[:, None] * normal)[:, None]
    corner = (columns * np.arange(len(path) - 1)[:, None] + np.arange(columns - 1)).ravel()
    here, beside, below, across_below = corner, corner + 1, corner + columns, corner + columns + 1
    triangles = np.concatenate([np.stack(c, -1) for c in ((here, below, across_below), (here, across_below, beside))])
    on_rim = np.zeros((len(path), columns), bool)
    on_rim[[0, -1]] = on_rim[:, [0, -1]] = True
    return Patch(vertices.reshape(-1, 2), triangles, on_rim.ravel(), contact_angle)


def drop_patch(outline: Outline, contact_angle: float, segments: int, rings: int) -> Patch:
    """The patch of a drop that holds the water of its disks."""
    return star(outline.middle, rim_of(outline, segments), rings, contact_angle, outline.radius)
