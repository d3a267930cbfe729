"""The embedded scene `street`: a side street opens between lit houses, in the evening after sunset."""

from collections.abc import Iterator

import numpy as np

from hydroviews.blender.embedded_scenes.camera_paths import Path
from hydroviews.blender.embedded_scenes.meshes import (
    annulus,
    box,
    gable,
    joined,
    lathe,
    lumpy,
    moved,
    prism,
    rod,
    sphere,
)
from hydroviews.blender.embedded_scenes.objects import barrel, crates, pot
from hydroviews.blender.embedded_scenes.pieces import Design, Lamp, Piece, Rng, Sky, Vector
from hydroviews.blender.embedded_scenes.street_things import (
    advertising_column,
    bicycle,
    car,
    fairy_lights,
    seat,
    street_lamp,
)

KERB = 4.0  # metres: the main street's far kerb lies at this y, houses stand behind the pavement
FRONT = 6.2
CORNER = 3.6  # half the width between the houses of the side street, which runs along +y
WALLS = ("dark brick", "ochre plaster", "pale brick", "rose plaster", "field stone", "blue plaster")
LIT = ("amber window", "pale window", "curtained window")


def make_street(rng: Rng) -> list[Piece | Lamp]:
    """All pieces and lamps; the same generator state gives the same street."""
    parts = (_ground, _main_row, _side_rows, _end, _lamps, _cars, _corner, _trees)
    return [thing for part, child in zip(parts, rng.spawn(len(parts)), strict=True) for thing in part(child)]


def _ground(rng: Rng) -> Iterator[Piece]:
    yield Piece("land", annulus([1.0, 60.0, 140.0], np.array([[-0.4] * 32, [-0.4] * 32, [6.0] * 32])), "hill")
    roads = [moved(box(60, 16, 0.2), (0, KERB - 8, -0.2)), moved(box(4.4, 44, 0.2), (0, KERB + 22, -0.199))]
    yield Piece("roadway", joined(*roads), "wet cobbles")
    for name, material, edge, top in (("pavement", "paving", 0.0, 0.12), ("kerb", "stone", 0.14, 0.115)):
        slabs = [
            moved(box(27.8 + edge, 48 + edge, 0.3), (side * 16.1, KERB + 24.0 - edge / 2, top - 0.3))
            for side in (-1, 1)
        ]
        yield Piece(name, joined(*slabs), material)


def _main_row(rng: Rng) -> Iterator[Piece | Lamp]:
    """Houses with their fronts along the main street, then some that close its ends."""
    count = 0
    for side in (-1, 1):
        x = CORNER
        for _ in range(3):
            width = rng.uniform(4.6, 5.8)
            place = (side * (x + width / 2), FRONT + 2.0 + rng.uniform(0, 0.25), 0.0)
            yield from _house(rng, f"house {count}", count, place, width, 0.0)
            x, count = x + width + 0.02, count + 1
        for k in range(3):
            width = rng.uniform(4.6, 5.4)
            place = (side * 20.5, FRONT - 2.0 - 5.5 * k, 0.0)
            yield from _house(rng, f"house {count}", count + side, place, width, -side * np.pi / 2)
            count += 1


def _side_rows(rng: Rng) -> Iterator[Piece | Lamp]:
    for side in (-1, 1):
        y = FRONT + 4.6
        for k in range(4):
            width = rng.uniform(4.6, 5.6)
            place = (side * (CORNER + 2.0 + rng.uniform(0, 0.2)), y + width / 2, 0.0)
            yield from _house(rng, f"side house {side} {k}", 2 * k + side + 1, place, width, -side * np.pi / 2)
            y += width + 0.02


def _house(rng: Rng, name: str, which: int, place: Vector, width: float, turn: float) -> Iterator[Piece]:
    """Four metres deep, its front at local -y; every second one has a shop on the ground floor."""
    depth, upper = 4.0, int(rng.integers(1, 3))
    height, front = 3.1 + 2.3 * upper, -2.0
    yield Piece(f"{name} walls", box(width, depth, height), WALLS[which % len(WALLS)], place, turn)
    yield Piece(f"{name} ledge", moved(box(width + 0.1, depth + 0.24, 0.14), (0, 0, 3.0)), "stone", place, turn)
    roof = moved(gable(width + 0.2, depth + 0.7, rng.uniform(1.4, 2.1)), (0, 0, height))
    yield Piece(f"{name} roof", roof, ("slate roof", "red roof")[which % 2], place, turn)
    chimney = moved(box(0.5, 0.5, 2.4), (rng.uniform(-0.35, 0.35) * width, 0.4, height))
    yield Piece(f"{name} chimney", chimney, "dark brick", place, turn)
    columns = np.linspace(-width / 2 + 0.95, width / 2 - 0.95, 3)
    windows = [(x, 3.75 + 2.3 * floor) for floor in range(upper) for x in columns]
    if which % 2 == 0:
        yield from _shop(rng, name, width, place, turn)
    else:
        windows += [(x, 1.15) for x in columns[1:]]
        door = [moved(box(0.95, 0.16, 2.2), (columns[0], front, 0.12))]
        yield Piece(f"{name} door", joined(*door), ("painted wood", "oak")[which // 2 % 2], place, turn)
        lantern = moved(lathe([(0.06, 0.0), (0.1, 0.2), (0.04, 0.26)], 8, False), (columns[0], front - 0.16, 2.45))
        yield Piece(f"{name} door lantern", lantern, "bulb", place, turn)
    yield from _windows(rng, name, windows, place, turn)


def _windows(rng: Rng, name: str, windows: list[tuple[float, float]], place: Vector, turn: float) -> Iterator[Piece]:
    """Windows whose lower edges are at (x, z) of a front, about half of them lit."""
    frames = []
    panes: dict[str, list] = {}
    for x, z in windows:
        frames += [moved(box(1.02, 0.2, 0.1), (x, -2.0, z + h)) for h in (-0.1, 1.4)]
        frames += [moved(box(0.08, 0.2, 1.4), (x + dx, -2.0, z)) for dx in (-0.47, 0.47)]
        frames += [moved(box(0.05, 0.16, 1.4), (x, -2.0, z)), moved(box(0.9, 0.16, 0.05), (x, -2.0, z + 0.9))]
        look = LIT[int(rng.integers(len(LIT)))] if rng.random() < 0.55 else "window"
        panes.setdefault(look, []).append(moved(box(0.9, 0.1, 1.4), (x, -2.0, z)))
    yield Piece(f"{name} window frames", joined(*frames), "stone", place, turn)
    for look, meshes in panes.items():
        yield Piece(f"{name} {look}s", joined(*meshes), look, place, turn)


def _shop(rng: Rng, name: str, width: float, place: Vector, turn: float) -> Iterator[Piece]:
    front, wide = -2.0, width - 1.7
    left = -width / 2 + 0.3
    look = ("shop window", "book shop window")[int(rng.integers(2))]
    yield Piece(f"{name} shop", moved(box(wide, 0.1, 1.75), (left + wide / 2, front - 0.02, 0.7)), look, place, turn)
    wood = [moved(box(0.1, 0.26, 2.45), (x, front, 0.12)) for x in np.linspace(left, left + wide, 4)]
    wood += [moved(box(wide + 0.1, 0.3, h), (left + wide / 2, front, z)) for z, h in ((0.12, 0.55), (2.45, 0.5))]
    wood.append(moved(box(0.1, 0.26, 2.45), (width / 2 - 0.2, front, 0.12)))
    paint = ("painted wood", "yellow wood", "oak")[int(rng.integers(3))]
    yield Piece(f"{name} shop front", joined(*wood), paint, place, turn)
    door = moved(box(0.85, 0.14, 2.2), (width / 2 - 0.75, front, 0.12))
    yield Piece(f"{name} shop door", door, "curtained window", place, turn)
    sign = [moved(box(0.3, 0.02, 0.2), (left + 0.4 + 0.42 * k, front - 0.18, 2.6)) for k in range(int(wide / 0.45))]
    yield Piece(f"{name} sign", joined(*sign), ("red sign", "white sign")[int(rng.integers(2))], place, turn)
    slope = prism([(0.1, -0.04), (1.1, -0.38), (1.1, -0.33), (0.1, 0.01)], wide)
    awning = moved(slope, (left + wide / 2, front, 3.0), -np.pi / 2)
    cloth = ("striped cloth", "blue cloth")[int(rng.integers(2))]
    yield Piece(f"{name} awning", awning, cloth, place, turn)


def _end(rng: Rng) -> Iterator[Piece]:
    """What closes the view along the side street: a church against the last light."""
    yield Piece("nave", box(9.0, 8.0, 8.0), "field stone", (3.0, 46.0, 0.0))
    yield Piece("nave roof", moved(gable(9.6, 8.6, 3.5), (0, 0, 8.0)), "slate roof", (3.0, 46.0, 0.0))
    yield Piece("tower", box(4.0, 4.0, 14.0), "field stone", (-2.0, 44.0, 0.0))
    spire = lathe([(2.6, 14.0), (0.9, 18.0), (0.05, 24.0)], 8, smooth=False)
    yield Piece("spire", spire, "slate roof", (-2.0, 44.0, 0.0))
    glass = [moved(box(0.9, 0.2, 2.6), (x, -2.1, z)) for x, z in ((0, 3.0), (0, 9.5))]
    yield Piece("tower windows", joined(*glass), "amber window", (-2.0, 44.0, 0.0))


def _lamps(rng: Rng) -> Iterator[Piece | Lamp]:
    places = [(-4.6, 4.6), (4.6, 4.6), (-11.5, 4.6), (11.5, 4.6), (-2.5, 14.0), (2.5, 21.0), (-2.5, 29.0)]
    places += [(-8.6, -1.6), (8.6, -1.6)]
    for i, (x, y) in enumerate(places):
        yield from street_lamp(f"lamp {i}", (x, y, 0.1), 300.0)
    for i, (y, z) in enumerate(((8.6, 5.0), (14.0, 5.4), (20.0, 5.4))):
        yield from fairy_lights(rng, f"fairy lights {i}", (-CORNER, y, z), (CORNER, y, z + 0.3))


def _cars(rng: Rng) -> Iterator[Piece]:
    paints = ("red paint", "blue paint", "cream paint", "green paint")
    for i, (x, y, turn) in enumerate(((-8.4, 2.9, 0.0), (7.2, 2.9, np.pi), (13.0, 2.9, 0.0), (-14.5, 2.9, np.pi))):
        yield from car(f"car {i}", paints[i], (x + rng.uniform(-0.3, 0.3), y, 0.0), turn)
    yield from car("far car", "blue paint", (1.3, 18.0, 0.0), np.pi / 2)


def _corner(rng: Rng) -> Iterator[Piece]:
    yield Piece("island", lathe([(1.5, -0.1), (1.5, 0.12), (1.42, 0.14)], 40, smooth=False), "stone", (0.2, 1.2, 0.0))
    yield from advertising_column("column", (0.2, 1.2, 0.14))
    yield from bicycle("bicycle", "red paint", (-5.3, 4.75, 0.12), 0.1)
    yield from bicycle("second bicycle", "green paint", (3.1, 5.5, 0.12), 1.2)
    yield from seat("seat", (6.3, 5.3, 0.12), 0.0)
    yield from crates(rng, "corner", (-6.6, 5.6, 0.12))
    yield from barrel(rng, "corner", (-7.5, 5.7, 0.12))
    for i, x in enumerate((-10.2, -3.3, 8.2, 9.9)):
        yield from pot(rng, f"corner {i}", (x, 5.6, 0.12))


def _trees(rng: Rng) -> Iterator[Piece]:
    for i, (x, y) in enumerate(((-14.0, 4.9), (14.6, 4.9), (1.0, 1.9), (-0.5, 1.8))):
        if i < 2:
            trunk = lathe([(0.2, 0.0), (0.15, 0.5), (0.12, 3.0), (0.08, 3.6)], 16)
            yield Piece(f"tree {i} trunk", trunk, "bark", (x, y, 0.0))
            for k in range(3):
                size = rng.uniform(0.9, 1.3)
                crown = lumpy(sphere(size), rng, 0.16 * size, 2.2 / size)
                dx, dy = rng.uniform(-0.6, 0.6, 2)
                yield Piece(f"tree {i} crown {k}", crown, "autumn leaves", (x + dx, y + dy, 3.4 + 0.7 * k))
        else:
            bush = lumpy(sphere(0.36), rng, 0.08, 5.0)
            yield Piece(f"bush {i}", bush, ("leaves", "flowers")[i % 2], (x, y, 0.35))
    rails = [rod((-3.1, y, 0.75), (-3.1, y + 1.6, 0.75), 0.03) for y in (6.6, 8.6)]
    rails += [rod((-3.1, y, 0.1), (-3.1, y, 0.75), 0.03) for y in (6.6, 8.2, 8.6, 10.2)]
    yield Piece("rails", joined(*rails), "iron")


DUSK = Sky(
    zenith=(0.035, 0.06, 0.16),
    horizon=(0.34, 0.26, 0.3),
    ground=(0.05, 0.05, 0.06),
    glow=(0.7, 0.32, 0.12),
    clouds=(0.3, 0.2, 0.24),
    sun_direction=(-0.2, 1.0, 0.02),  # only its glow: it has just set behind the church
)
ACROSS = Path(
    radius=7.4,
    radius_spread=0.5,
    height=1.8,
    height_spread=0.5,
    target=(0.0, 4.0, 2.3),
    target_spread=0.3,
    centre=(0.0, 3.0),
    start=np.radians(-136),
    span=np.radians(92),
    waves=(7.0, 13.0),
)
STREET = Design(make_street, DUSK, ACROSS, samples=16, clean_error=0.45, drops_cost=3.5)
