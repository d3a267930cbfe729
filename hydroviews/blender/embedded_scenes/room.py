"""The embedded scene `room`: a furnished room, seen from along its large front window, which is left out."""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from hydroviews.blender.embedded_scenes.camera_paths import Path
from hydroviews.blender.embedded_scenes.furniture import (
    armchair,
    book_row,
    chair,
    floor_lamp,
    palm,
    picture,
    round_table,
    sofa,
)
from hydroviews.blender.embedded_scenes.meshes import annulus, box, joined, lathe, lumpy, moved, pillow, rod, sphere
from hydroviews.blender.embedded_scenes.objects import pot, vase
from hydroviews.blender.embedded_scenes.pieces import Design, Lamp, Piece, Rng, Sky

HALF_WIDTH, FRONT, BACK, HEIGHT = 3.6, -3.0, 2.8, 2.8  # metres: walls at x = -3.6 and 3.6, y = 2.8
WINDOW = (-0.7, 1.6, 0.9, 2.35)  # in the right wall: y from and to, z from and to


def make_room(rng: Rng) -> list[Piece | Lamp]:
    """All pieces and lamps; the same generator state gives the same room."""
    parts = (_shell, _window, _garden, _fireplace, _bookcase, _cabinet, _sideboard, _seats, _tables, _plants, _lamps)
    return [thing for part, child in zip(parts, rng.spawn(len(parts)), strict=True) for thing in part(child)]


def _shell(rng: Rng) -> Iterator[Piece]:
    depth, middle = BACK - FRONT + 1.2, (BACK + FRONT) / 2 - 0.3
    yield Piece("floor", moved(box(2 * HALF_WIDTH, depth, 0.2), (0, middle, -0.2)), "parquet")
    yield Piece("ceiling", moved(box(2 * HALF_WIDTH, depth, 0.2), (0, middle, HEIGHT)), "ceiling")
    beams = [moved(box(0.2, depth, 0.18), (x, middle, HEIGHT - 0.18)) for x in np.linspace(-3, 3, 5)]
    yield Piece("beams", joined(*beams), "oak")
    yield Piece("back wall", moved(box(2 * HALF_WIDTH, 0.2, HEIGHT), (0, BACK + 0.1, 0)), "green wallpaper")
    yield Piece("left wall", moved(box(0.2, depth, HEIGHT), (-HALF_WIDTH - 0.1, middle, 0)), "cream wallpaper")
    near, far, sill, lintel = WINDOW
    x, low, high = HALF_WIDTH + 0.1, middle - depth / 2, middle + depth / 2
    walls = [
        moved(box(0.2, near - low, HEIGHT), (x, (near + low) / 2, 0)),
        moved(box(0.2, high - far, HEIGHT), (x, (high + far) / 2, 0)),
        moved(box(0.2, far - near, sill), (x, (near + far) / 2, 0)),
        moved(box(0.2, far - near, HEIGHT - lintel), (x, (near + far) / 2, lintel)),
    ]
    yield Piece("right wall", joined(*walls), "cream wallpaper")
    panels = [moved(box(0.04, 0.5, 0.72), (-HALF_WIDTH + 0.02, y, 0.12)) for y in np.arange(FRONT, BACK, 0.6)]
    panels += [moved(box(0.06, depth, h), (-HALF_WIDTH + 0.03, middle, z)) for h, z in ((0.1, 0.0), (0.07, 0.88))]
    panels += [moved(box(2 * HALF_WIDTH, 0.05, h), (0, BACK - 0.025, z)) for h, z in ((0.12, 0.0), (0.1, 2.5))]
    yield Piece("panelling", joined(*panels), "walnut")


def _window(rng: Rng) -> Iterator[Piece]:
    near, far, sill, lintel = WINDOW
    x, y, wide, high = HALF_WIDTH + 0.08, (near + far) / 2, far - near, lintel - sill
    bars = [moved(box(0.1, 0.08, high), (x, at, sill)) for at in np.linspace(near + 0.04, far - 0.04, 4)]
    bars += [moved(box(0.1, wide, 0.08), (x, y, at)) for at in (sill, sill + 0.95, lintel - 0.08)]
    yield Piece("window frame", joined(*bars), "ceiling")
    yield Piece("window board", moved(box(0.5, wide + 0.2, 0.05), (HALF_WIDTH - 0.1, y, sill - 0.05)), "walnut")
    rail = rod((HALF_WIDTH - 0.12, near - 0.6, 2.5), (HALF_WIDTH - 0.12, far + 0.6, 2.5), 0.025)
    yield Piece("curtain rail", rail, "bronze")
    for name, at in (("near", near - 0.22), ("far", far + 0.22)):
        phase = np.linspace(0, 10 * np.pi, 80)
        wave = np.column_stack([0.07 * np.sin(phase), np.linspace(-0.33, 0.33, 80)])
        cloth = [moved(box(0.03, 0.02, 2.3), (HALF_WIDTH - 0.12 + dx, at + dy, 0.16)) for dx, dy in wave]
        yield Piece(f"{name} curtain", joined(*cloth), "curtain")


def _garden(rng: Rng) -> Iterator[Piece]:
    yield Piece("lawn", annulus([1.0, 12.0, 40.0], np.array([[-0.5] * 32, [-0.4] * 32, [1.0] * 32])), "grass")
    for i in range(9):
        size = rng.uniform(0.6, 1.1)
        place = (rng.uniform(7.5, 13.0), 1.4 * (i - 4) + rng.uniform(-0.5, 0.5) + 2, rng.uniform(0.2, 1.4))
        tree = lumpy(sphere(size), rng, 0.16 * size, 2.2 / size)
        yield Piece(f"tree {i}", tree, ("leaves", "autumn leaves", "leaves")[i % 3], place)


def _fireplace(rng: Rng) -> Iterator[Piece | Lamp]:
    front = BACK - 0.5
    hearth = [moved(box(0.4, 0.5, 0.85), (x, BACK - 0.25, 0)) for x in (-0.65, 0.65)]
    hearth += [moved(box(1.7, 0.5, 0.3), (0, BACK - 0.25, 0.85)), moved(box(0.9, 0.06, 0.85), (0, BACK - 0.03, 0))]
    yield Piece("fireplace", joined(*hearth), "red brick")
    yield Piece("chimney breast", moved(box(1.5, 0.34, HEIGHT - 1.15), (0, BACK - 0.17, 1.15)), "pale brick")
    yield Piece("mantelpiece", moved(box(2.0, 0.62, 0.08), (0, BACK - 0.29, 1.15)), "walnut")
    yield Piece("hearthstone", moved(box(1.9, 0.9, 0.05), (0, BACK - 0.55, 0)), "stone")
    logs = [rod((x - 0.28, y, z), (x + 0.28, y + 0.08, z), 0.06) for x, y, z in ((0, 2.45, 0.12), (0.05, 2.58, 0.2))]
    yield Piece("logs", joined(*logs), "bark")
    yield Piece("fire", moved(lumpy(pillow(0.55, 0.22, 0.24), rng, 0.1, 9.0), (0, 2.6, 0.2)), "embers")
    yield Lamp("fire light", (0.0, 2.45, 0.4), 9.0, (1.0, 0.45, 0.15), radius=0.12)
    yield from picture("dawn", 1.1, 0.8, (0.0, BACK - 0.34, 1.5))
    for i, x in enumerate((-0.82, -0.6, 0.62, 0.85)):
        shape = vase(rng.uniform(0.2, 0.36))
        yield Piece(f"mantel vase {i}", shape, ("china", "terracotta", "bronze")[i % 3], (x, front + 0.12, 1.23))
    clock = moved(lathe([(0.12, 0.0), (0.13, 0.03), (0.13, 0.09), (0.1, 0.1)]), (0, 0, 0.14), np.pi / 2, np.pi / 2)
    yield Piece("clock", clock, "gilt", (-0.1, front + 0.06, 1.22))


def _bookcase(rng: Rng) -> Iterator[Piece]:
    left, right, y = -3.45, -1.25, BACK - 0.18
    boards = [moved(box(right - left, 0.34, 0.04), ((left + right) / 2, y, z)) for z in np.linspace(0.08, 2.3, 7)]
    boards += [moved(box(0.05, 0.36, 2.36), (x, y, 0)) for x in (left, (left + right) / 2, right)]
    boards.append(moved(box(right - left, 0.03, 2.34), ((left + right) / 2, BACK - 0.02, 0)))
    yield Piece("bookcase", joined(*boards), "walnut")
    middle = (left + right) / 2
    for row, (low, above) in enumerate(pairwise(np.linspace(0.12, 2.34, 7))):
        for side, start in enumerate((left + 0.04, middle + 0.04)):
            end = start + (right - left) / 2 - 0.08
            yield from book_row(rng, f"books {row} {side}", start, end, (y - 0.02, low), above - low - 0.06)


def _cabinet(rng: Rng) -> Iterator[Piece]:
    x, y = 2.2, BACK - 0.26
    yield Piece("cabinet", moved(box(1.7, 0.5, 0.95), (0, 0, 0.05)), "oak", (x, y, 0.0))
    doors = [moved(box(0.74, 0.04, 0.78), (side * 0.4, -0.26, 0.12)) for side in (-1, 1)]
    yield Piece("cabinet doors", joined(*doors), "painted wood", (x, y, 0.0))
    shelf = [moved(box(1.6, 0.22, 0.04), (0, 0.12, z)) for z in (1.45, 1.85)]
    yield Piece("plate shelf", joined(*shelf), "oak", (x, y, 0.0))
    for i in range(9):
        on_shelf = i % 3
        place = (
            x - 0.62 + 0.42 * (i // 3) + rng.uniform(-0.04, 0.04),
            y + 0.05 * on_shelf,
            (1.0, 1.49, 1.89)[on_shelf],
        )
        if on_shelf:
            dish = moved(lathe([(0.04, 0.0), (0.15, 0.03), (0.16, 0.05)]), (0, 0.1, 0.16), np.pi / 2, -1.3)
        else:
            dish = vase(rng.uniform(0.22, 0.34))
        yield Piece(f"dish {i}", dish, ("china", "terracotta", "green china", "gilt")[i % 4], place)


def _sideboard(rng: Rng) -> Iterator[Piece | Lamp]:
    x, y, turn = -HALF_WIDTH + 0.3, 0.3, np.pi / 2
    yield Piece("sideboard", moved(box(1.8, 0.46, 0.78), (0, 0, 0.06)), "walnut", (x, y, 0.0), turn)
    drawers = [moved(box(0.52, 0.03, 0.2), (dx, -0.24, z)) for dx in (-0.58, 0, 0.58) for z in (0.12, 0.36, 0.6)]
    yield Piece("drawers", joined(*drawers), "oak", (x, y, 0.0), turn)
    yield Piece("table lamp foot", vase(0.36), "green china", (x, y + 0.55, 0.84))
    shade = lathe([(0.22, 0.0), (0.14, 0.26)])
    yield Piece("table lamp shade", shade, "lampshade", (x, y + 0.55, 1.22))
    yield Lamp("table lamp", (x, y + 0.55, 1.34), 14.0, (1.0, 0.66, 0.34), radius=0.12)
    stack = [moved(box(0.3 - 0.03 * i, 0.22, 0.04), (0, 0, 0.04 * i), 0.3 * i) for i in range(4)]
    yield Piece("stack of books", joined(*stack), "red books", (x, y - 0.1, 0.84))
    yield from pot(rng, "sideboard", (x, y - 0.6, 0.84))
    for i, (name, at, wide, high) in enumerate((("meadow", 0.85, 0.7, 0.9), ("coast", -0.15, 0.75, 0.55))):
        yield from picture(name, wide, high, (-HALF_WIDTH, at, 1.25 + 0.2 * i), turn)
    yield from picture("dawn", 0.6, 0.5, (-HALF_WIDTH, -1.1, 1.4), turn, "second ")


def _seats(rng: Rng) -> Iterator[Piece]:
    yield Piece("rug", moved(box(2.8, 2.8, 0.03), (1.4, 1.4, 0)), "rug", (-1.4, -1.35, 0.0))
    yield from sofa("sofa", (-1.75, 0.75, 0.0), 0.5)
    yield from armchair("armchair", "mustard cloth", (1.25, 1.05, 0.0), -0.6)
    pouf = moved(pillow(0.62, 0.62, 0.4), (0, 0, 0.22))
    yield Piece("pouf", pouf, "red plaid", (0.95, -0.75, 0.0), rng.uniform(0, 1))
    for i, place in enumerate(((1.95, 0.42), (2.95, -0.1))):
        yield from chair(f"chair {i}", (*place, 0.0), (2.2, -0.9)[i])


def _tables(rng: Rng) -> Iterator[Piece]:
    top = [moved(box(1.1, 0.65, 0.05), (0, 0, 0.4)), moved(box(0.95, 0.5, 0.03), (0, 0, 0.15))]
    legs = [moved(box(0.07, 0.07, 0.4), (x, y, 0)) for x in (-0.48, 0.48) for y in (-0.25, 0.25)]
    yield Piece("low table", joined(*top, *legs), "oak", (-0.35, -0.15, 0.03), 0.25)
    bowl = lathe([(0.08, 0.0), (0.2, 0.1), (0.22, 0.13), (0.2, 0.13), (0.08, 0.03)])
    yield Piece("bowl", bowl, "china", (-0.15, -0.1, 0.48))
    fruit = [moved(sphere(0.055, 12, 16), (0.08 * np.cos(a), 0.08 * np.sin(a), 0.12)) for a in np.arange(5) * 1.26]
    yield Piece("fruit", joined(*fruit), "autumn leaves", (-0.15, -0.1, 0.48))
    for i, (material, size) in enumerate((("blue books", 0.34), ("pale books", 0.28), ("green books", 0.24))):
        book = box(size, 0.7 * size, 0.045)
        yield Piece(f"table book {i}", book, material, (-0.65, -0.25, 0.48 + 0.045 * i), rng.uniform(-0.5, 0.5))
    yield from round_table("tea table", (2.62, 0.62, 0.0))
    yield from palm(rng, "tea palm", (2.75, 0.7, 0.76), 0.35)
    for i, angle in enumerate((0.4, 2.6, 4.1)):
        cup = lathe([(0.03, 0.0), (0.045, 0.03), (0.05, 0.09), (0.04, 0.09), (0.03, 0.02)], 20)
        yield Piece(f"cup {i}", cup, "china", (2.6 + 0.3 * np.cos(angle), 0.62 + 0.3 * np.sin(angle), 0.76))


def _plants(rng: Rng) -> Iterator[Piece]:
    yield from palm(rng, "palm", (3.05, 2.0, 0.0), 1.0)
    yield from palm(rng, "small palm", (-3.2, 1.75, 0.0), 0.8)
    yield from palm(rng, "sill palm", (3.4, 1.3, 0.9), 0.3)
    for i, y in enumerate((-0.35, 0.2)):
        shape = vase(rng.uniform(0.2, 0.28))
        yield Piece(f"sill vase {i}", shape, ("terracotta", "green china")[i], (3.42, y, 0.9))


def _lamps(rng: Rng) -> Iterator[Piece | Lamp]:
    yield from floor_lamp("floor lamp", (-0.95, 2.15, 0.0), 16.0)
    glass = (0.0, FRONT - 0.7, 1.6)
    yield Lamp("front window", glass, 430.0, (0.95, 0.97, 1.0), size=(6.4, 2.2), direction=(0, 1, -0.1))
    near, far, sill, lintel = WINDOW
    place = (HALF_WIDTH + 0.25, (near + far) / 2, (sill + lintel) / 2)
    size = (far - near, lintel - sill)
    yield Lamp("side window", place, 150.0, (0.86, 0.94, 1.0), size=size, direction=(-1, 0, -0.15))


MORNING = Sky(
    zenith=(0.3, 0.5, 0.95),
    horizon=(0.85, 0.95, 1.05),
    ground=(0.3, 0.3, 0.26),
    glow=(0.3, 0.25, 0.17),
    clouds=(1.1, 1.1, 1.12),
    sun_direction=(0.8, 0.12, 0.5),
    sun_strength=5.0,
)
ALONG_THE_GLASS = Path(
    radius=3.65,
    radius_spread=0.25,
    height=1.5,
    height_spread=0.35,
    target=(0.0, 0.9, 1.08),
    target_spread=0.2,
    centre=(0.0, 0.8),
    start=np.radians(-142),
    span=np.radians(104),
    waves=(7.0, 13.0),
)
ROOM = Design(make_room, MORNING, ALONG_THE_GLASS, samples=14, clean_error=0.35, drops_cost=2.7)
