"""Small things that stand about in more than one scene; each stands on the given place."""

from collections.abc import Iterator

import numpy as np

from hydroviews.blender.embedded_scenes.meshes import Mesh, box, joined, lathe, lumpy, moved, sphere
from hydroviews.blender.embedded_scenes.pieces import Piece, Rng, Vector


def vase(height: float) -> Mesh:
    """A bulging vase of that height."""
    profile = np.array([(0.22, 0.0), (0.4, 0.25), (0.46, 0.5), (0.34, 0.78), (0.22, 0.9), (0.28, 1.0), (0.2, 0.97)])
    return lathe(profile * height)


def crates(rng: Rng, name: str, place: Vector) -> Iterator[Piece]:
    """A crate with a box on it."""
    size = rng.uniform(0.5, 0.7)
    yield Piece(f"{name} crate", box(size, size, size), "oak", place, rng.uniform(0, np.pi))
    above = (place[0], place[1], size)
    yield Piece(f"{name} box", box(0.6 * size, 0.5 * size, 0.4 * size), "yellow wood", above, rng.uniform(0, np.pi))


def pot(rng: Rng, name: str, place: Vector) -> Iterator[Piece]:
    """A plant in a pot."""
    pot = lathe([(0.2, 0.0), (0.3, 0.4), (0.34, 0.4), (0.34, 0.48), (0.28, 0.48), (0.26, 0.42)])
    yield Piece(f"{name} pot", pot, "terracotta", place)
    crown = lumpy(sphere(0.36), rng, 0.07, 5.0)
    yield Piece(f"{name} plant", crown, ("flowers", "leaves")[int(rng.integers(2))], (place[0], place[1], 0.66))


def barrel(rng: Rng, name: str, place: Vector) -> Iterator[Piece]:
    """A barrel with two hoops."""
    yield Piece(f"{name} barrel", lathe([(0.27, 0.0), (0.35, 0.3), (0.36, 0.45), (0.27, 0.85)]), "oak", place)
    hoops = [lathe([(r, z), (r, z + 0.06)]) for r, z in ((0.325, 0.14), (0.34, 0.64))]
    yield Piece(f"{name} hoops", joined(*hoops), "bronze", place)


def rock(rng: Rng, name: str, place: Vector) -> Iterator[Piece]:
    """A rock, lower part in the ground."""
    size = rng.uniform(0.22, 0.42)
    yield Piece(
        f"{name} rock", lumpy(sphere(size), rng, 0.3 * size, 1.4 / size), "stone", (place[0], place[1], size / 2)
    )


def bench(rng: Rng, name: str, place: Vector) -> Iterator[Piece]:
    """A bench of three boards."""
    turn = rng.uniform(0, np.pi)
    seat = [moved(box(1.3, 0.12, 0.06), (0, y, 0.44)) for y in (-0.16, 0.0, 0.16)]
    legs = [moved(box(0.1, 0.42, 0.44), (x, 0, 0)) for x in (-0.5, 0.5)]
    yield Piece(f"{name} bench", joined(*seat, *legs), "painted wood", place, turn)


def bush(rng: Rng, name: str, place: Vector) -> Iterator[Piece]:
    """A round bush."""
    bush = lumpy(sphere(0.42), rng, 0.1, 5.0)
    yield Piece(f"{name} bush", bush, ("autumn leaves", "flowers")[int(rng.integers(2))], (place[0], place[1], 0.3))
