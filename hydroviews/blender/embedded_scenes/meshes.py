"""Shapes as vertices and faces, made with numpy alone: z is up, lengths are metres."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Mesh:
    """Vertices [N, 3] and faces as tuples of vertex indices, anticlockwise seen from outside."""

    vertices: Array
    faces: list[tuple[int, ...]]
    smooth: bool = False


def joined(*meshes: Mesh) -> Mesh:
    """One mesh of all; smooth if the first is."""
    faces: list[tuple[int, ...]] = []
    offset = 0
    for mesh in meshes:
        faces += [tuple(i + offset for i in face) for face in mesh.faces]
        offset += len(mesh.vertices)
    vertices = np.concatenate([np.zeros((0, 3)), *(mesh.vertices for mesh in meshes)])
    return Mesh(vertices, faces, bool(meshes) and meshes[0].smooth)


def moved(mesh: Mesh, offset: ArrayLike, turn: float = 0.0, tilt: float = 0.0) -> Mesh:
    """Tilted about y, then turned about z (radians), then shifted."""
    c, s = np.cos(turn), np.sin(turn)
    ct, st = np.cos(tilt), np.sin(tilt)
    rotation = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.array([[ct, 0, st], [0, 1, 0], [-st, 0, ct]])
    return replace(mesh, vertices=mesh.vertices @ rotation.T + np.asarray(offset, float))


def box(width: float, depth: float, height: float) -> Mesh:
    """A box standing on z = 0, centred in x and y."""
    x, y = width / 2, depth / 2
    low = [(-x, -y, 0.0), (x, -y, 0.0), (x, y, 0.0), (-x, y, 0.0)]
    vertices = np.array(low + [(a, b, height) for a, b, _ in low])
    sides = [(i, (i + 1) % 4, (i + 1) % 4 + 4, i + 4) for i in range(4)]
    return Mesh(vertices, [(3, 2, 1, 0), (4, 5, 6, 7), *sides])


def gable(width: float, depth: float, height: float) -> Mesh:
    """A ridge roof over a width x depth rectangle; the ridge runs along x."""
    x, y = width / 2, depth / 2
    vertices = [(-x, -y, 0), (x, -y, 0), (x, y, 0), (-x, y, 0), (-x, 0, height), (x, 0, height)]
    return Mesh(np.array(vertices, float), [(0, 1, 5, 4), (2, 3, 4, 5), (1, 2, 5), (3, 0, 4), (3, 2, 1, 0)])


def prism(outline: ArrayLike, depth: float) -> Mesh:
    """An outline (x, z) [N, 2], anticlockwise seen from -y, drawn out along y and centred there."""
    outline = np.asarray(outline, float)
    n = len(outline)
    front, back = (np.column_stack([outline[:, 0], np.full(n, y), outline[:, 1]]) for y in (-depth / 2, depth / 2))
    sides = [(i, n + i, n + (i + 1) % n, (i + 1) % n) for i in range(n)]
    return Mesh(np.concatenate([front, back]), [tuple(range(n)), tuple(range(2 * n - 1, n - 1, -1)), *sides])


def rod(start: ArrayLike, end: ArrayLike, radius: float, segments: int = 10) -> Mesh:
    """A straight round bar between two points."""
    start, end = np.asarray(start, float), np.asarray(end, float)
    length = float(np.linalg.norm(end - start))
    x, y, z = (end - start) / length
    upright = lathe([(radius, 0.0), (radius, length)], segments)
    return moved(upright, start, turn=float(np.arctan2(y, x)), tilt=float(np.arccos(np.clip(z, -1, 1))))


def lathe(profile: ArrayLike, segments: int = 40, smooth: bool = True, closed: bool = False) -> Mesh:
    """A solid of revolution about z.

    Args:
        profile: (radius, z) pairs [N, 2], from the bottom up along the outside.
        segments: steps around.
        smooth: whether the surface is shaded without edges.
        closed: whether the profile is a closed curve, which makes a ring; otherwise flat ends close the solid.
    """
    profile = np.asarray(profile, float)
    angles = np.linspace(0, 2 * np.pi, segments, endpoint=False)
    ring = np.stack([np.cos(angles), np.sin(angles)], -1)
    vertices = np.concatenate([np.column_stack([r * ring, np.full(segments, z)]) for r, z in profile])
    if closed:
        return Mesh(vertices, _grid_faces(len(profile), segments, closed=True), smooth)
    last = (len(profile) - 1) * segments
    ends = [tuple(range(segments - 1, -1, -1)), tuple(range(last, last + segments))]
    return Mesh(vertices, _grid_faces(len(profile), segments) + ends, smooth)


def sphere(radius: float, rings: int = 32, segments: int = 48) -> Mesh:
    """A ball around the origin."""
    angles = np.linspace(-np.pi / 2, np.pi / 2, rings)[1:-1]
    return lathe(radius * np.column_stack([np.cos(angles), np.sin(angles)]), segments)


def pillow(width: float, depth: float, height: float) -> Mesh:
    """A soft block around the origin: a superellipsoid."""
    ball = sphere(1.0, rings=20, segments=32)
    swollen = np.sign(ball.vertices) * np.abs(ball.vertices) ** 0.5
    return replace(ball, vertices=swollen * (width / 2, depth / 2, height / 2))


def blade(length: float, width: float, rise: float, steps: int = 7) -> Mesh:
    """A leaf from the origin along +x that rises, bends and comes to a point; seen from both sides."""
    t = np.linspace(0, 1, steps)
    middle = np.column_stack([length * t, np.zeros(steps), rise * np.sin(2.2 * t)])
    half = width / 2 * np.sin(np.pi * np.clip(0.12 + 0.88 * t, 0, 1))
    left, right = (middle + side * half[:, None] * (0.0, 1.0, 0.25) for side in (-1, 1))
    faces: list[tuple[int, ...]] = [(i, i + 1, steps + i + 1, steps + i) for i in range(steps - 1)]
    return Mesh(np.concatenate([left, right]), faces, smooth=True)


def lumpy(mesh: Mesh, rng: np.random.Generator, amplitude: float, frequency: float) -> Mesh:
    """Push vertices in and out along their direction from the origin by smooth noise of the given amplitude."""
    push = np.zeros(len(mesh.vertices))
    for octave in range(4):
        waves = rng.standard_normal((6, 3)) * frequency * 2**octave
        phases = rng.uniform(0, 2 * np.pi, 6)
        push += np.sin(mesh.vertices @ waves.T + phases).sum(axis=1) / 2**octave
    direction = mesh.vertices / np.maximum(np.linalg.norm(mesh.vertices, axis=1, keepdims=True), 1e-9)
    return replace(mesh, vertices=mesh.vertices + direction * (amplitude * push / 4)[:, None])


def knot(radius: float, tube: float, turns: int = 2, loops: int = 3, around: int = 20, along: int = 260) -> Mesh:
    """A torus knot around z: `turns` times about the axis, `loops` times about the ring."""
    t = np.linspace(0, 2 * np.pi, along, endpoint=False)
    centre = _knot_curve(t, radius, turns, loops)
    tangent = _knot_curve(t + 1e-4, radius, turns, loops) - _knot_curve(t - 1e-4, radius, turns, loops)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    normal = np.cross(tangent, np.cross(centre, tangent))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    side = np.cross(tangent, normal)
    a = np.linspace(0, 2 * np.pi, around, endpoint=False)[:, None]
    points = centre[:, None] + tube * (np.cos(a) * normal[:, None] + np.sin(a) * side[:, None])
    return Mesh(points.reshape(-1, 3), _grid_faces(along, around, closed=True), smooth=True)


def _knot_curve(t: Array, radius: float, turns: int, loops: int) -> Array:
    ring = radius * (1 + 0.36 * np.cos(loops * t))
    return np.stack([ring * np.cos(turns * t), ring * np.sin(turns * t), -0.58 * radius * np.sin(loops * t)], -1)


def annulus(radii: ArrayLike, heights: Array) -> Mesh:
    """Ground around the origin: vertices at radii [R] and heights [R, S], S steps around."""
    radii = np.asarray(radii, float)
    segments = heights.shape[1]
    angles = np.linspace(0, 2 * np.pi, segments, endpoint=False)
    x, y = radii[:, None] * np.cos(angles), radii[:, None] * np.sin(angles)
    inwards = [face[::-1] for face in _grid_faces(len(radii), segments)]
    return Mesh(np.stack([x, y, heights], -1).reshape(-1, 3), inwards, smooth=True)


def _grid_faces(rows: int, columns: int, closed: bool = False) -> list[tuple[int, ...]]:
    """Quadrilaterals between rows of vertices whose columns wrap around, and whose rows do if `closed`."""
    faces: list[tuple[int, ...]] = []
    for i in range(rows if closed else rows - 1):
        here, above = i * columns, (i + 1) % rows * columns
        for j in range(columns):
            k = (j + 1) % columns
            faces.append((here + j, here + k, above + k, above + j))
    return faces
