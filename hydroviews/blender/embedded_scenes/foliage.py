"""Plants whose leaves, branches and blades are shapes of their own; each stands on the given place."""

from collections.abc import Iterator

import numpy as np

from hydroviews.blender.embedded_scenes.meshes import Array, Mesh, joined, lathe, lumpy, moved, pillow, rod, sphere
from hydroviews.blender.embedded_scenes.pieces import Piece, Rng, Vector

Branch = tuple[Array, Array, float]  # from, to, radius


def leaves(rng: Rng, places: Array, length: float) -> Mesh:
    """A pointed leaf about each of the places [N, 3], in any direction; seen from both sides."""
    n = len(places)
    along, side = rng.standard_normal((2, n, 3))
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    side -= along * np.sum(along * side, axis=1, keepdims=True)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    half = length / 2 * rng.uniform(0.7, 1.2, (n, 1))
    corners = np.stack([-along * half, side * half * 0.55, along * half, -side * half * 0.55], axis=1)
    return _quads(places[:, None] + corners)


def blades(rng: Rng, places: Array, height: float, width: float) -> Mesh:
    """A blade of grass on each of the places [N, 3]: it leans, bends and comes to a narrow end."""
    n = len(places)
    angle = rng.uniform(0, 2 * np.pi, n)
    side = np.stack([np.cos(angle), np.sin(angle), np.zeros(n)], -1) * width / 2
    lean = rng.normal(0, 0.28, (n, 3)) * (1, 1, 0)
    tall = height * rng.uniform(0.6, 1.1, (n, 1))
    middle = places + 0.55 * tall * ((0, 0, 1) + 0.5 * lean)
    tip = places + tall * ((0, 0, 1) + 1.3 * lean)
    lower = np.stack([places - side, places + side, middle + 0.8 * side, middle - 0.8 * side], axis=1)
    upper = np.stack([middle - 0.8 * side, middle + 0.8 * side, tip + 0.1 * side, tip - 0.1 * side], axis=1)
    return _quads(np.concatenate([lower, upper]))


def _quads(corners: Array) -> Mesh:
    """A mesh of separate quadrilaterals [N, 4, 3]."""
    faces: list[tuple[int, ...]] = [(i, i + 1, i + 2, i + 3) for i in range(0, 4 * len(corners), 4)]
    return Mesh(corners.reshape(-1, 3), faces)


def tree(
    rng: Rng, name: str, place: Vector, height: float, foliage: str, bark: str = "bark", leaf: float = 0.16
) -> Iterator[Piece]:
    """A tree of that height: a trunk, three orders of branches and leaves about the thinnest.

    No leaves and one more order of branches if `leaf` is 0.
    """
    bare = leaf == 0
    trunk = np.array([0.0, 0.0, 0.42 * height])
    below = [(0.045 * height, -0.1), (0.03 * height, 0.1 * height), (0.022 * height, 0.44 * height)]
    yield Piece(f"{name} trunk", lathe(below, 12), bark, place)
    branches = list(_branches(rng, trunk, np.array([0.0, 0.0, 1.0]), 0.2 * height, 0.018 * height, 4 if bare else 3))
    yield Piece(f"{name} branches", joined(*(rod(*branch, 6) for branch in branches)), bark, place)
    if not bare:
        twigs = [(start, end) for start, end, radius in branches if radius < 0.01 * height]
        starts, ends = np.array([twig for twig in twigs for _ in range(45)]).transpose(1, 0, 2)
        along = starts + (ends - starts) * rng.uniform(0.1, 1.2, (len(starts), 1))
        around = along + rng.normal(0, 0.042 * height, along.shape)
        yield Piece(f"{name} leaves", leaves(rng, around, leaf), foliage, place)


def _branches(rng: Rng, start: Array, direction: Array, length: float, radius: float, orders: int) -> Iterator[Branch]:
    end = start + direction * length
    yield start, end, radius
    if orders == 0:
        return
    turn = rng.uniform(0, 2 * np.pi)
    for k in range(3):
        spread = rng.uniform(0.4, 0.9)
        angle = turn + k * 2 * np.pi / 3 + rng.uniform(-0.4, 0.4)
        bent = direction + spread * np.array([np.cos(angle), np.sin(angle), rng.uniform(-0.2, 0.4)])
        fork = start + (end - start) * rng.uniform(0.6, 1.0)
        yield from _branches(rng, fork, bent / np.linalg.norm(bent), 0.86 * length, 0.62 * radius, orders - 1)


def shrub(rng: Rng, name: str, place: Vector, size: float, foliage: str, leaf: float = 0.13) -> Iterator[Piece]:
    """A round shrub, `size` wide, of leaves around a dark core."""
    core = moved(lumpy(sphere(0.4 * size, 20, 28), rng, 0.05 * size, 4.0 / size), (0, 0, 0.32 * size))
    yield Piece(f"{name} core", core, "undergrowth", place)
    direction = rng.standard_normal((int(11 * (size / leaf) ** 2), 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    direction[:, 2] = np.abs(direction[:, 2]) * 0.9 - 0.1
    shell = direction * rng.uniform(0.38, 0.52, (len(direction), 1)) * size + (0, 0, 0.32 * size)
    yield Piece(f"{name} leaves", leaves(rng, shell, leaf), foliage, place)


def reeds(rng: Rng, name: str, place: Vector, height: float) -> Iterator[Piece]:
    """A clump of reeds with brown heads on a few stalks."""
    feet = np.column_stack([rng.normal(0, 0.16, (46, 2)), np.full(46, -0.15)])
    yield Piece(f"{name} reeds", blades(rng, feet, height, 0.045), "reed", place)
    stalks = [(x, y, height * rng.uniform(0.8, 1.05)) for x, y, _ in feet[:6]]
    yield Piece(
        f"{name} stalks", joined(*(rod((x, y, -0.15), (x, y, z), 0.01, 6) for x, y, z in stalks)), "reed", place
    )
    heads = [moved(lathe([(0.01, 0), (0.03, 0.03), (0.03, 0.2), (0.01, 0.23)], 10), stalk) for stalk in stalks]
    yield Piece(f"{name} heads", joined(*heads), "bark", place)


def hedge(rng: Rng, name: str, place: Vector, turn: float, length: float, height: float) -> Iterator[Piece]:
    """A clipped hedge along x."""
    body = moved(lumpy(pillow(length, 0.9, height), rng, 0.05, 3.0), (0, 0, height / 2 - 0.05))
    yield Piece(name, body, "undergrowth", place, turn)
    n = int(130 * length * height)
    x, z = rng.uniform(-length / 2, length / 2, n), rng.uniform(0.05, 1.02, n) * height
    y = 0.44 * np.where(rng.random(n) < 0.5, -1, 1) * np.where(z > 0.9 * height, rng.random(n), 1.0)
    yield Piece(f"{name} leaves", leaves(rng, np.column_stack([x, y, z]), 0.13), "foliage", place, turn)
