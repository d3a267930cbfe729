"""What stands and hangs in `market`; everything is on the given place, its front at local -y."""

from collections.abc import Callable, Iterator

import numpy as np

from hydroviews.blender.embedded_scenes.meshes import (
    Mesh,
    box,
    joined,
    lathe,
    lumpy,
    moved,
    pillow,
    prism,
    rod,
    sphere,
)
from hydroviews.blender.embedded_scenes.objects import vase
from hydroviews.blender.embedded_scenes.pieces import Lamp, Piece, Rng, Vector

FRUIT = ("orange peel", "apple skin", "lime peel", "plum skin", "lemon peel")
CLOTHS = ("striped cloth", "plaid", "mustard cloth", "blue cloth", "red plaid", "upholstery")
COATS = ("blue paint", "mustard cloth", "plaid", "green paint", "upholstery", "red plaid")


def hanging_lamp(name: str, place: Vector, ceiling: float, watts: float) -> Iterator[Piece | Lamp]:
    """An enamelled shade with a bulb, on a cable from the ceiling; `place` is the bulb's."""
    x, y, z = place
    yield Piece(f"{name} cable", rod((0, 0, 0.16), (0, 0, ceiling - z), 0.012, 6), "iron", place)
    profile = [(0.3, -0.02), (0.31, 0.0), (0.22, 0.1), (0.08, 0.17), (0.07, 0.17), (0.2, 0.09), (0.29, -0.01)]
    yield Piece(f"{name} shade", lathe(profile, 32, closed=True), "green paint", place)
    yield Piece(f"{name} bulb", sphere(0.07, 12, 16), "bulb", place)
    yield Lamp(name, (x, y, z - 0.02), watts, (1.0, 0.78, 0.5), radius=0.07)


def person(rng: Rng, name: str, place: Vector, turn: float) -> Iterator[Piece]:
    """A standing figure of 1.55 to 1.85 m, without a face, in a coat and perhaps a hat."""
    tall = rng.uniform(0.9, 1.07)
    legs = [rod((x, 0, 0.05), (0.7 * x, 0, 0.85), 0.085) for x in (-0.13, 0.13)]
    shoes = [moved(pillow(0.11, 0.28, 0.11), (x, -0.05, 0.05)) for x in (-0.13, 0.13)]
    coat = lathe([(0.24, 0.55), (0.25, 0.7), (0.19, 1.02), (0.23, 1.3), (0.2, 1.42), (0.07, 1.48)], 24)
    flat = _scaled(coat, (1.0, 0.66, 1.0))
    reach = rng.uniform(-0.28, 0.0, 2)
    arms = [
        part
        for side, forward in zip((-1, 1), reach, strict=True)
        for part in (
            rod((0.22 * side, 0, 1.38), (0.31 * side, 0.3 * forward, 1.1), 0.06),
            rod((0.31 * side, 0.3 * forward, 1.1), (0.27 * side, forward - 0.08, 0.9), 0.05),
        )
    ]
    face = moved(_scaled(sphere(0.115, 16, 20), (0.85, 1.0, 1.15)), (0, -0.01, 1.62))
    head = [face, rod((0, 0, 1.44), (0, 0, 1.55), 0.05)]
    hands = [moved(sphere(0.05, 8, 10), (0.27 * s, f - 0.09, 0.87)) for s, f in zip((-1, 1), reach, strict=True)]
    hair = moved(_scaled(sphere(0.125, 16, 20), (0.88, 0.95, 0.9)), (0, 0.03, 1.67))
    brim = lathe([(0.2, 1.7), (0.2, 1.715), (0.125, 1.72), (0.115, 1.8), (0.08, 1.84)], 24)
    hat = rng.random() < 0.5
    apron = moved(box(0.3, 0.02, 0.62), (0, -0.165, 0.6))
    coat_look = COATS[int(rng.integers(len(COATS)))]
    for part, mesh, look in (
        ("legs", joined(*legs, *shoes), "tyre"),
        ("coat", joined(flat, *arms), coat_look),
        ("skin", joined(*head, *hands), "skin"),
        ("head", brim if hat else hair, "walnut" if hat else "bark"),
        ("apron", apron, CLOTHS[int(rng.integers(len(CLOTHS)))]),
    ):
        yield Piece(f"{name} {part}", _scaled(mesh, (1.0, 1.0, tall)), look, place, turn)


def _scaled(mesh: Mesh, factors: Vector) -> Mesh:
    return Mesh(mesh.vertices * factors, mesh.faces, mesh.smooth)


def stall(rng: Rng, name: str, place: Vector, turn: float, goods: str, cloth: str) -> Iterator[Piece]:
    """A table of 2.3 by 1 m below a canopy of that cloth, laden with one of `GOODS`."""
    posts = [rod((x, y, 0), (x, y, h), 0.03) for x in (-1.15, 1.15) for y, h in ((-0.55, 2.15), (0.55, 2.5))]
    table = [moved(box(2.3, 1.0, 0.06), (0, 0, 0.78)), moved(box(2.2, 0.04, 0.6), (0, -0.46, 0.16))]
    legs = [moved(box(0.08, 0.08, 0.78), (x, y, 0)) for x in (-1.05, 1.05) for y in (-0.4, 0.4)]
    yield Piece(f"{name} posts", joined(*posts), "iron", place, turn)
    wood = ("oak", "yellow wood", "painted wood")[int(rng.integers(3))]
    yield Piece(f"{name} table", joined(*table, *legs), wood, place, turn)
    slope = prism([(-0.75, 2.12), (0.6, 2.52), (0.6, 2.55), (-0.75, 2.15)], 2.6)
    fringe = moved(box(0.02, 2.6, 0.2), (-0.75, 0, 1.95))
    yield Piece(f"{name} canopy", moved(joined(slope, fringe), (0, 0, 0), np.pi / 2), cloth, place, turn)
    for piece in GOODS[goods](rng, name):
        yield _on(piece, place, turn)


def _on(piece: Piece, place: Vector, turn: float) -> Piece:
    """A piece that was placed along a stall's axes, put where the stall is."""
    (x, y, z), c, s = piece.position, np.cos(turn), np.sin(turn)
    at = (place[0] + c * x - s * y, place[1] + s * x + c * y, place[2] + z)
    return Piece(piece.name, piece.mesh, piece.material, at, piece.turn + turn)


def _fruit(rng: Rng, name: str) -> Iterator[Piece]:
    """Eight tilted crates of fruit, and scales."""
    crate = [moved(box(0.5, 0.42, 0.02), (0, 0, 0.02))]
    crate += [moved(box(0.5, 0.02, 0.14), (0, y, 0)) for y in (-0.2, 0.2)]
    crate += [moved(box(0.02, 0.42, 0.14), (x, 0, 0)) for x in (-0.24, 0.24)]
    first = int(rng.integers(len(FRUIT)))
    for i in range(8):
        at = (-0.82 + 0.55 * (i % 4), -0.22 + 0.44 * (i // 4), 0.85 + 0.1 * (i // 4))
        yield Piece(f"{name} crate {i}", joined(*crate), "oak", at)
        size = rng.uniform(0.036, 0.055)
        x, y = rng.uniform(-0.2, 0.2, 34), rng.uniform(-0.16, 0.16, 34)
        z = 0.05 + rng.uniform(0, 0.13, 34) * (1 - 9 * x**2) * (1 - 14 * y**2)
        heap = [moved(sphere(size, 8, 12), where) for where in zip(x, y, z, strict=True)]
        yield Piece(f"{name} fruit {i}", joined(*heap), FRUIT[(first + i * 2 + i // 4) % len(FRUIT)], at)
    pan = [lathe([(0.05, 0.3), (0.17, 0.33), (0.19, 0.38), (0.17, 0.36), (0.05, 0.31)], 28), box(0.2, 0.24, 0.26)]
    yield Piece(f"{name} scales", joined(*pan), "chrome", (1.0, 0.36, 0.84))


def _fish(rng: Rng, name: str) -> Iterator[Piece]:
    """Fish in rows on steel trays with ice."""
    body = _scaled(sphere(1.0, 12, 16), (0.17, 0.05, 0.028))
    tail = prism([(-0.15, 0.0), (-0.25, -0.03), (-0.25, 0.03)], 0.1)
    for i in range(3):
        at = (-0.74 + 0.74 * i, 0.0, 0.84)
        tray = [box(0.7, 0.9, 0.03), *(moved(box(0.7, 0.02, 0.09), (0, y, 0)) for y in (-0.44, 0.44))]
        yield Piece(f"{name} tray {i}", joined(*tray), "chrome", at)
        ice = moved(lumpy(pillow(0.66, 0.84, 0.12), rng, 0.02, 16.0), (0, 0, 0.05))
        yield Piece(f"{name} ice {i}", ice, "ice", at)
        fish = []
        for k in range(12):
            where = (-0.17 + 0.34 * (k % 2), -0.34 + 0.135 * (k // 2), 0.13)
            turn = rng.normal(0, 0.12) + np.pi * (k % 2)
            fish += [moved(body, where, turn), moved(tail, where, turn)]
        yield Piece(f"{name} fish {i}", joined(*fish), ("fish skin", "salmon skin", "fish skin")[i], at)


def _cloth(rng: Rng, name: str) -> Iterator[Piece]:
    """Bolts of cloth on the table, lengths of it on a rail behind."""
    for i in range(9):
        look = CLOTHS[(i * 5 + int(rng.integers(2))) % len(CLOTHS)]
        bolt = moved(rod((0, -0.4, 0), (0, 0.4, 0), 0.09, 20), (0, 0, 0.09))
        yield Piece(f"{name} bolt {i}", bolt, look, (-0.96 + 0.24 * i, 0.0, 0.84), rng.normal(0, 0.06))
    for i in range(5):
        wave = np.linspace(-0.2, 0.2, 14)
        strips = [moved(box(0.034, 0.02, 1.2), (dx, 0.04 * np.sin(30 * dx), 0)) for dx in wave]
        yield Piece(f"{name} length {i}", joined(*strips), CLOTHS[i], (-0.9 + 0.45 * i, 0.5, 1.2))


def _pottery(rng: Rng, name: str) -> Iterator[Piece]:
    """Vases and bottles in rows."""
    for i in range(15):
        at = (-0.95 + 0.47 * (i % 5) + rng.uniform(-0.05, 0.05), -0.32 + 0.3 * (i // 5), 0.84)
        if rng.random() < 0.5:
            shape, look = vase(rng.uniform(0.24, 0.42)), ("china", "terracotta", "green china", "blue tiles")[i % 4]
        else:
            shape = lathe([(0.05, 0.0), (0.06, 0.02), (0.06, 0.22), (0.02, 0.3), (0.02, 0.38)], 20)
            look = ("green glass", "brown glass")[i % 2]
        yield Piece(f"{name} ware {i}", shape, look, at)


GOODS: dict[str, Callable[[Rng, str], Iterator[Piece]]] = {
    "fruit": _fruit,
    "fish": _fish,
    "cloth": _cloth,
    "pottery": _pottery,
}
