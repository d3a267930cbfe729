"""The embedded scene `courtyard`: a paved courtyard between houses, by day."""

from collections.abc import Iterator

import numpy as np

from hydroviews.blender.embedded_scenes.camera_paths import Path
from hydroviews.blender.embedded_scenes.meshes import (
    Mesh,
    annulus,
    box,
    gable,
    joined,
    knot,
    lathe,
    lumpy,
    moved,
    sphere,
)
from hydroviews.blender.embedded_scenes.objects import barrel, bench, bush, crates, pot, rock, vase
from hydroviews.blender.embedded_scenes.pieces import Design, Piece, Rng, Sky, Vector

HOUSE_RADIUS = 13.0  # metres from the centre to the houses' middle
TREE_RADIUS = 9.8
COLUMN_RADIUS = 3.5
CLUTTER_RADII = (1.9, 4.7)  # cameras keep further out than this
WALLS = ("red brick", "ochre plaster", "pale brick", "blue plaster", "field stone", "rose plaster")


def make_courtyard(rng: Rng) -> list[Piece]:
    """All pieces; the same generator state gives the same courtyard."""
    parts = (_ground, _hills, _houses, _trees, _columns, _centrepiece, _clutter, _fences)
    return [piece for part, child in zip(parts, rng.spawn(len(parts)), strict=True) for piece in part(child)]


def _ground(rng: Rng) -> Iterator[Piece]:
    yield Piece("paving", lathe([(3.0, -0.2), (3.0, 0.03)], 64, smooth=False), "paving")
    yield Piece(
        "kerb", lathe([(3.0, 0.0), (3.25, 0.0), (3.25, 0.09), (3.0, 0.09)], 64, smooth=False, closed=True), "stone"
    )
    yield Piece("cobbles", lathe([(9.0, -0.3), (9.0, 0.0)], 96, smooth=False), "cobbles")
    heights = np.vstack([np.full(96, -0.02), 0.06 + 0.05 * rng.standard_normal((4, 96)), np.full(96, 0.0)])
    yield Piece("lawn", annulus([8.9, 9.6, 10.4, 12.0, 16.0, 26.0], heights), "grass")


def _hills(rng: Rng) -> Iterator[Piece]:
    angles = np.linspace(0, 2 * np.pi, 160, endpoint=False)
    relief = np.ones(160)
    for k in range(1, 12):
        relief += rng.normal(0, 0.5 / k) * np.sin(k * angles + rng.uniform(0, 2 * np.pi))
    heights = np.outer([-0.2, 2.0, 5.0, 8.0], np.clip(relief, 0.35, 1.8))
    yield Piece("hills", annulus([24.0, 32.0, 42.0, 56.0], heights), "hill")


def _houses(rng: Rng) -> Iterator[Piece]:
    count = 13
    for i in range(count):
        angle = 2 * np.pi * (i + rng.uniform(-0.06, 0.06)) / count
        radius = HOUSE_RADIUS + rng.uniform(-0.5, 0.8)
        place = (radius * np.cos(angle), radius * np.sin(angle), 0.0)
        yield from _house(rng, f"house {i}", WALLS[i % len(WALLS)], place, angle - np.pi / 2)


def _house(rng: Rng, name: str, wall: str, place: Vector, turn: float) -> Iterator[Piece]:
    """Its front is at local -y, towards the centre of the courtyard."""
    width, depth, height = rng.uniform(4.9, 6.0), rng.uniform(3.0, 3.8), rng.uniform(3.4, 6.4)
    front = -depth / 2
    floors, columns = int(height / 1.75), int(width / 1.45)
    frames, panes = [], []
    door = int(rng.integers(columns))
    for floor in range(floors):
        for column in range(columns):
            x, z = (column - (columns - 1) / 2) * 1.45, 0.75 + 1.75 * floor
            if floor == 0 and column == door:
                continue
            frames.append(moved(box(0.86, 0.2, 1.12), (x, front, z - 0.06)))
            frames.append(moved(box(1.02, 0.36, 0.1), (x, front, z - 0.14)))
            panes.append(moved(box(0.68, 0.24, 0.92), (x, front, z + 0.04)))
    at = (door - (columns - 1) / 2) * 1.45
    yield Piece(f"{name} walls", box(width, depth, height), wall, place, turn)
    yield Piece(f"{name} frames", joined(*frames), "stone", place, turn)
    yield Piece(f"{name} panes", joined(*panes), "window", place, turn)
    wood = ("painted wood", "oak", "yellow wood")[int(rng.integers(3))]
    yield Piece(f"{name} door", moved(box(0.95, 0.22, 2.05), (at, front, 0)), wood, place, turn)
    yield Piece(f"{name} step", moved(box(1.3, 0.9, 0.14), (at, front, 0)), "stone", place, turn)
    roof = moved(gable(width + 0.5, depth + 0.7, rng.uniform(1.3, 2.0)), (0, 0, height))
    yield Piece(f"{name} roof", roof, ("red roof", "slate roof")[int(rng.integers(2))], place, turn)
    chimney = moved(box(0.55, 0.55, 2.2), (rng.uniform(-0.35, 0.35) * width, 0.5, height))
    yield Piece(f"{name} chimney", chimney, "red brick", place, turn)
    if rng.random() < 0.6:
        awning = moved(box(1.6, 1.1, 0.05), (at, front - 0.45, 2.3))
        yield Piece(f"{name} awning", awning, ("striped cloth", "blue cloth")[int(rng.integers(2))], place, turn)


def _trees(rng: Rng) -> Iterator[Piece]:
    count = 9
    for i in range(count):
        angle = 2 * np.pi * (i + 0.5 + rng.uniform(-0.2, 0.2)) / count
        radius = TREE_RADIUS + rng.uniform(0, 0.8)
        x, y, height = radius * np.cos(angle), radius * np.sin(angle), rng.uniform(1.5, 2.3)
        trunk = lathe([(0.26, -0.1), (0.18, 0.4), (0.15, height), (0.1, height + 0.6)], 16)
        yield Piece(f"tree {i} trunk", trunk, "bark", (x, y, 0.0))
        leaves = "autumn leaves" if i % 3 == 1 else "leaves"
        for k in range(3):
            size = rng.uniform(0.65, 0.95)
            crown = lumpy(sphere(size), rng, 0.16 * size, 2.2 / size)
            offset = rng.uniform(-0.45, 0.45, 2)
            yield Piece(f"tree {i} crown {k}", crown, leaves, (x + offset[0], y + offset[1], height + 0.5 + 0.5 * k))


def _columns(rng: Rng) -> Iterator[Piece]:
    shafts = ("striped cloth", "stone", "green tiles", "red brick", "blue tiles", "pale brick", "stone")
    turn = rng.uniform(0, 2 * np.pi)
    for i, shaft in enumerate(shafts):
        angle = turn + 2 * np.pi * i / len(shafts)
        x, y, height = COLUMN_RADIUS * np.cos(angle), COLUMN_RADIUS * np.sin(angle), rng.uniform(0.9, 2.0)
        yield Piece(f"column {i} base", box(0.9, 0.9, 0.16), "stone", (x, y, 0.0), angle)
        yield Piece(f"column {i}", lathe([(0.34, 0.1), (0.31, 0.6), (0.26, height)], 40), shaft, (x, y, 0.0), angle)
        yield Piece(f"column {i} cap", box(0.78, 0.78, 0.14), "stone", (x, y, height), angle)
        mesh, material = _ornament(rng, i)
        yield Piece(f"column {i} ornament", mesh, material, (x, y, height + 0.14), angle + np.pi / 2)


def _ornament(rng: Rng, which: int) -> tuple[Mesh, str]:
    """What stands on a column, its foot at z = 0, and its material."""
    if which % 4 == 0:
        return moved(lumpy(sphere(0.4), rng, 0.05, 2.5), (0, 0, 0.38)), ("bronze", "yellow wood")[which // 4 % 2]
    if which % 4 == 1:
        return moved(knot(0.3, 0.075), (0, 0, 0.24)), ("blue cloth", "bronze")[which // 4 % 2]
    if which % 4 == 2:
        return vase(0.62), ("terracotta", "blue tiles")[which // 4 % 2]
    return moved(box(0.5, 0.5, 0.5), (0, 0, 0.02), turn=0.6), "green tiles"


def _centrepiece(rng: Rng) -> Iterator[Piece]:
    for side, x in (("left", -1.25), ("right", 1.25)):
        yield Piece(f"pier {side}", box(0.62, 0.62, 2.1), "red brick", (x, 0.0, 0.0))
        yield Piece(f"impost {side}", box(0.8, 0.8, 0.14), "stone", (x, 0.0, 2.1))
    wedges = []
    for angle in np.pi * np.arange(13) / 12:
        wedge = moved(box(0.46, 0.6, 0.34), (0, 0, -0.17))
        wedge = moved(wedge, (1.25 * np.cos(angle), 0, 1.25 * np.sin(angle)), tilt=-angle)
        wedges.append(wedge)
    yield Piece("arch", joined(*wedges), "pale brick", (0.0, 0.0, 2.24))
    yield Piece("plinth", lathe([(0.85, 0.0), (0.85, 0.18), (0.68, 0.22), (0.6, 0.62), (0.7, 0.7)], 8, False), "stone")
    yield Piece("knot", moved(knot(0.55, 0.15), (0, 0, 0.45)), "blue tiles", (0.0, 0.0, 0.72), rng.uniform(0, np.pi))


def _clutter(rng: Rng) -> Iterator[Piece]:
    makers = (crates, pot, barrel, rock, bench, pot, rock, bush)
    taken: list[tuple[float, float]] = []
    for i in range(24):
        place = _free_place(rng, taken)
        taken.append(place)
        yield from makers[i % len(makers)](rng, f"clutter {i}", (*place, 0.0))


def _free_place(rng: Rng, taken: list[tuple[float, float]]) -> tuple[float, float]:
    """The one of some random places that is furthest from those taken and from the columns' ring."""
    angle, radius = rng.uniform(0, 2 * np.pi, 40), rng.uniform(*CLUTTER_RADII, 40)
    places = np.stack([radius * np.cos(angle), radius * np.sin(angle)], -1)
    room = np.abs(radius - COLUMN_RADIUS) + 0.4
    for place in taken:
        room = np.minimum(room, np.linalg.norm(places - place, axis=1))
    x, y = places[np.argmax(room)]
    return float(x), float(y)


def _fences(rng: Rng) -> Iterator[Piece]:
    for i in range(5):
        angle = 2 * np.pi * (i + rng.uniform(0.2, 0.8)) / 5
        posts = [moved(box(0.1, 0.06, 0.9 + 0.12 * (k % 2)), (0.22 * (k - 6), 0, 0)) for k in range(13)]
        rails = [moved(box(2.8, 0.05, 0.08), (0, 0.05, z)) for z in (0.3, 0.68)]
        place = (9.1 * np.cos(angle), 9.1 * np.sin(angle), 0.0)
        paint = ("yellow wood", "painted wood")[i % 2]
        yield Piece(f"fence {i}", joined(*posts, *rails), paint, place, angle - np.pi / 2)


DAY = Sky(
    zenith=(0.22, 0.45, 0.95),
    horizon=(0.8, 0.92, 1.08),
    ground=(0.34, 0.32, 0.28),
    glow=(0.315, 0.2625, 0.175),
    clouds=(1.12, 1.12, 1.14),
    sun_direction=(0.55, -0.35, 0.76),
    sun_strength=4.6,
)
AROUND = Path(radius=7.1, radius_spread=0.5, height=2.0, height_spread=0.6, target=(0, 0, 1.15), target_spread=0.35)
COURTYARD = Design(make_courtyard, DAY, AROUND, clean_error=1.2)
