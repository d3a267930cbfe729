"""Furniture of `room`; everything stands on the given place, its front at local -y."""

from collections.abc import Iterator

import numpy as np

from hydroviews.blender.embedded_scenes.meshes import blade, box, joined, lathe, moved, pillow, rod
from hydroviews.blender.embedded_scenes.pieces import Lamp, Piece, Rng, Vector

BOOKS = ("red books", "blue books", "green books", "pale books")


def sofa(name: str, place: Vector, turn: float) -> Iterator[Piece]:
    """Three seats with cushions."""
    soft = [moved(pillow(2.1, 0.95, 0.34), (0, 0, 0.28)), moved(pillow(2.0, 0.3, 0.75), (0, 0.4, 0.55))]
    soft += [moved(pillow(0.28, 0.9, 0.6), (x, 0, 0.38)) for x in (-1.0, 1.0)]
    soft += [moved(pillow(0.62, 0.7, 0.2), (x, -0.08, 0.5)) for x in (-0.6, 0.0, 0.6)]
    yield Piece(name, joined(*soft), "upholstery", place, turn)
    for i, (x, lean) in enumerate(((-0.62, 0.3), (0.1, -0.2), (0.68, 0.2))):
        cushion = moved(pillow(0.14, 0.46, 0.42), (x, 0.16, 0.78), np.pi / 2 + lean, -0.25)
        yield Piece(f"{name} cushion {i}", cushion, ("red plaid", "plaid", "mustard cloth")[i], place, turn)
    blanket = [moved(pillow(0.5, 0.34, 0.06), (0.62, 0.42, 0.93)), moved(pillow(0.5, 0.06, 0.4), (0.62, 0.23, 0.74))]
    yield Piece(f"{name} blanket", joined(*blanket), "plaid", place, turn)


def armchair(name: str, material: str, place: Vector, turn: float) -> Iterator[Piece]:
    """One deep seat on wooden feet."""
    soft = [moved(pillow(0.8, 0.8, 0.36), (0, 0, 0.3)), moved(pillow(0.76, 0.24, 0.8), (0, 0.34, 0.62))]
    soft += [moved(pillow(0.2, 0.74, 0.5), (x, 0, 0.42)) for x in (-0.38, 0.38)]
    yield Piece(name, joined(*soft), material, place, turn)
    feet = [moved(box(0.07, 0.07, 0.16), (x, y, 0)) for x in (-0.3, 0.3) for y in (-0.28, 0.28)]
    yield Piece(f"{name} feet", joined(*feet), "walnut", place, turn)
    cushion = moved(pillow(0.14, 0.42, 0.38), (0, 0.16, 0.66), np.pi / 2, -0.2)
    yield Piece(f"{name} cushion", cushion, "blue cloth", place, turn)


def chair(name: str, place: Vector, turn: float) -> Iterator[Piece]:
    """A wooden chair with a back of rods."""
    wood = [rod((x, y, 0), (0.9 * x, 0.9 * y, 0.45), 0.022) for x in (-0.2, 0.2) for y in (-0.19, 0.19)]
    wood += [rod((x, 0.19, 0.45), (1.1 * x, 0.26, 0.95), 0.016) for x in np.linspace(-0.2, 0.2, 5)]
    wood += [moved(box(0.46, 0.44, 0.04), (0, 0, 0.44)), moved(box(0.5, 0.05, 0.1), (0, 0.26, 0.9))]
    yield Piece(name, joined(*wood), "oak", place, turn)
    yield Piece(f"{name} cushion", moved(pillow(0.42, 0.4, 0.07), (0, 0, 0.51)), "red plaid", place, turn)


def round_table(name: str, place: Vector) -> Iterator[Piece]:
    """A table on one leg, with a cloth."""
    leg = lathe([(0.28, 0.0), (0.26, 0.03), (0.06, 0.1), (0.05, 0.4), (0.08, 0.66), (0.3, 0.7)])
    yield Piece(f"{name} leg", leg, "walnut", place)
    cloth = lathe([(0.53, 0.5), (0.5, 0.6), (0.49, 0.74), (0.46, 0.76)], 48)
    yield Piece(f"{name} cloth", cloth, "plaid", place)


def floor_lamp(name: str, place: Vector, watts: float) -> Iterator[Piece | Lamp]:
    """A shade on a pole."""
    pole = [lathe([(0.16, 0.0), (0.15, 0.03)]), rod((0, 0, 0), (0, 0, 1.6), 0.018)]
    yield Piece(f"{name} pole", joined(*pole), "bronze", place)
    yield Piece(f"{name} shade", lathe([(0.27, 1.5), (0.16, 1.84)]), "lampshade", place)
    yield Lamp(name, (place[0], place[1], 1.66), watts, (1.0, 0.68, 0.36), radius=0.13)


def book_row(
    rng: Rng, name: str, start: float, end: float, place: tuple[float, float], headroom: float
) -> Iterator[Piece]:
    """Books side by side along x from `start` to `end`, at y and z `place`; now and then there is a gap."""
    books: dict[str, list] = {material: [] for material in BOOKS}
    x = start
    while x < end - 0.07:
        thick, deep, high = rng.uniform(0.025, 0.065), rng.uniform(0.18, 0.25), rng.uniform(0.65, 0.98) * headroom
        if rng.random() < 0.94:
            book = moved(box(thick, deep, high), (x + thick / 2, -deep / 2 + 0.1, 0))
            books[BOOKS[int(rng.integers(len(BOOKS)))]].append(book)
        x += thick + (0.003 if rng.random() < 0.93 else rng.uniform(0.05, 0.12))
    for material, meshes in books.items():
        if meshes:
            yield Piece(f"{name} {material}", joined(*meshes), material, (0.0, *place))


def picture(
    subject: str, width: float, height: float, place: Vector, turn: float = 0.0, label: str = ""
) -> Iterator[Piece]:
    """A framed painting whose lower edge is in the middle of `place`, on a wall behind it."""
    rims = [moved(box(width + 0.14, 0.07, 0.07), (0, -0.035, z)) for z in (-0.07, height)]
    rims += [moved(box(0.07, 0.07, height), (x, -0.035, 0)) for x in (-width / 2 - 0.035, width / 2 + 0.035)]
    yield Piece(f"{label}{subject} frame", joined(*rims), "gilt", place, turn)
    # The painting's own axes begin in its corner, where its texture does.
    c, s = np.cos(turn), np.sin(turn)
    corner = (place[0] - c * width / 2, place[1] - s * width / 2, place[2])
    canvas = moved(box(width, 0.04, height), (width / 2, -0.02, 0))
    yield Piece(f"{label}{subject}", canvas, subject, corner, turn)


def palm(rng: Rng, name: str, place: Vector, size: float) -> Iterator[Piece]:
    """A plant of long bent leaves in a pot."""
    bowl = np.array([(0.16, 0.0), (0.24, 0.3), (0.27, 0.36), (0.22, 0.36), (0.2, 0.3)]) * size
    yield Piece(f"{name} pot", lathe(bowl), "terracotta", place)
    leaves = []
    for i in range(26):
        length, rise = rng.uniform(0.3, 0.62) * size, rng.uniform(0.35, 1.15) * size
        leaf = blade(length, rng.uniform(0.09, 0.15) * size, rise)
        leaves.append(moved(leaf, (0, 0, 0.28 * size), 2.4 * i + rng.uniform(-0.3, 0.3)))
    yield Piece(f"{name} leaves", joined(*leaves), "leaves", place)
