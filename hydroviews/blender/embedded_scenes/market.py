"""The embedded scene `market`: a market hall in use; cameras stand on a ring in its middle and look outward."""

from collections.abc import Iterator

import numpy as np

from hydroviews.blender.embedded_scenes.camera_paths import Path
from hydroviews.blender.embedded_scenes.furniture import picture
from hydroviews.blender.embedded_scenes.market_things import GOODS, hanging_lamp, person, stall
from hydroviews.blender.embedded_scenes.meshes import Mesh, box, joined, lathe, moved, rod
from hydroviews.blender.embedded_scenes.objects import barrel, crates, pot
from hydroviews.blender.embedded_scenes.pieces import Design, Lamp, Piece, Rng, Sky, Vector

LENGTH, WIDTH, EAVES = 22.0, 17.0, 5.2  # metres, along x, along y, and up to the roof
STALLS = 9  # in a ring around the middle
RING = 5.2  # its radius
CANOPIES = ("striped cloth", "sailcloth", "blue cloth", "mustard cloth", "green cloth")


def make_market(rng: Rng) -> list[Piece | Lamp]:
    """All pieces and lamps; the same generator state gives the same market."""
    parts = (_shell, _windows, _iron, _stalls, _second_row, _people, _clutter, _signs, _lamps)
    return [thing for part, child in zip(parts, rng.spawn(len(parts)), strict=True) for thing in part(child)]


def _on_ring(angle: float, radius: float, height: float = 0.0) -> Vector:
    return radius * float(np.cos(angle)), radius * float(np.sin(angle)), height


def _shell(rng: Rng) -> Iterator[Piece]:
    yield Piece("floor", moved(box(LENGTH, WIDTH, 0.2), (0, 0, -0.2)), "wet flags")
    for side in (-1, 1):
        long, end = (0.0, side * WIDTH / 2, 0.0), (side * LENGTH / 2, 0.0, 0.0)
        yield Piece(f"long wall {side}", box(LENGTH, 0.4, EAVES), "pale brick", long)
        yield Piece(f"end wall {side}", box(0.4, WIDTH, EAVES), "red brick", end)
        yield Piece(f"long dado {side}", box(LENGTH, 0.5, 0.9), "green tiles", long)
        yield Piece(f"end dado {side}", box(0.5, WIDTH, 0.9), "green tiles", end)
    yield Piece("ceiling", moved(box(LENGTH, WIDTH, 0.2), (0, 0, EAVES)), "oak")
    lights = [moved(box(1.6, 4.6, 0.06), (x, y, EAVES - 0.04)) for x in np.arange(-9, 10, 3.0) for y in (-4.5, 4.5)]
    yield Piece("skylights", joined(*lights), "daylight")


def _windows(rng: Rng) -> Iterator[Piece]:
    """Tall windows above the stalls, in every wall."""
    pane = moved(box(1.7, 0.1, 1.9), (0, 0, 2.9))
    bars = [moved(box(0.07, 0.2, 1.9), (x, 0, 2.9)) for x in (-0.85, -0.28, 0.28, 0.85)]
    bars += [moved(box(1.8, 0.22, 0.08), (0, 0, z)) for z in (2.86, 3.8, 4.76)]
    places = [((x, side * (WIDTH / 2 - 0.22), 0.0), 0.0) for side in (-1, 1) for x in np.arange(-8.8, 9.0, 4.4)]
    places += [((side * (LENGTH / 2 - 0.22), y, 0.0), np.pi / 2) for side in (-1, 1) for y in (-5.2, 0.0, 5.2)]
    yield Piece("panes", joined(*(moved(pane, *place) for place in places)), "daylight")
    yield Piece("window bars", joined(*(moved(joined(*bars), *place) for place in places)), "iron")


def _iron(rng: Rng) -> Iterator[Piece]:
    """Cast columns and the beams on them."""
    for i, (x, y) in enumerate((x, y) for x in (-7.2, -2.4, 2.4, 7.2) for y in (-6.3, 6.3)):
        profile = [(0.24, 0.0), (0.22, 0.4), (0.12, 0.5), (0.1, EAVES - 0.7), (0.17, EAVES - 0.6), (0.22, EAVES - 0.3)]
        yield Piece(f"column {i}", lathe(profile, 20), "green paint", (x, y, 0.0))
    beams = [moved(box(LENGTH, 0.2, 0.3), (0, y, EAVES - 0.3)) for y in (-6.3, 6.3)]
    beams += [moved(box(0.14, WIDTH, 0.22), (x, 0, EAVES - 0.25)) for x in (-7.2, -2.4, 2.4, 7.2)]
    yield Piece("beams", joined(*beams), "green paint")
    ties = [rod((x, -6.2, EAVES - 0.9), (x, 6.2, EAVES - 0.9), 0.025, 6) for x in (-7.2, -2.4, 2.4, 7.2)]
    yield Piece("ties", joined(*ties), "iron")


def _stalls(rng: Rng) -> Iterator[Piece]:
    """A ring of stalls with their fronts to the middle."""
    for i in range(STALLS):
        angle = 2 * np.pi * (i + rng.uniform(-0.06, 0.06)) / STALLS
        kind = tuple(GOODS)[i % len(GOODS)]
        place = _on_ring(angle, RING + rng.uniform(-0.2, 0.3))
        yield from stall(rng, f"stall {i} {kind}", place, angle - np.pi / 2, kind, CANOPIES[i % len(CANOPIES)])


def _second_row(rng: Rng) -> Iterator[Piece]:
    """Stalls along the long walls, which show through the gaps."""
    for side in (-1, 1):
        for k, x in enumerate((-8.6, -5.2, -1.6, 2.0, 5.4, 8.8)):
            kind = tuple(GOODS)[(k + side) % len(GOODS)]
            place = (x, side * (WIDTH / 2 - 1.0), 0.0)
            yield from stall(
                rng,
                f"wall stall {side} {k} {kind}",
                place,
                0.0 if side > 0 else np.pi,
                kind,
                CANOPIES[(k - side) % len(CANOPIES)],
            )


def _people(rng: Rng) -> Iterator[Piece]:
    """Sellers behind the stalls, buyers before them and in the gaps between them."""
    for i in range(STALLS):
        angle = 2 * np.pi * i / STALLS
        yield from person(rng, f"seller {i}", _on_ring(angle + rng.uniform(-0.05, 0.05), RING + 1.2), angle - np.pi / 2)
    for i in range(5):
        angle = 2 * np.pi * (2 * i + 0.5 + rng.uniform(-0.1, 0.1)) / STALLS
        yield from person(rng, f"buyer {i}", _on_ring(angle, rng.uniform(4.0, 5.0)), angle + rng.uniform(-2, 2))
    for i, (x, y) in enumerate(((-9.2, 1.4), (9.3, -2.2), (8.7, 2.6), (-8.8, -3.4))):
        yield from person(rng, f"walker {i}", (x, y, 0.0), rng.uniform(0, 2 * np.pi))


def _clutter(rng: Rng) -> Iterator[Piece]:
    """What stands on the floor beside the stalls."""
    makers = (crates, barrel, pot)
    for i in range(STALLS):
        angle = 2 * np.pi * (i + 0.5 + rng.uniform(-0.12, 0.12)) / STALLS
        yield from makers[i % 3](rng, f"clutter {i}", _on_ring(angle, rng.uniform(5.4, 6.0)))
    for i in range(6):
        angle = 2 * np.pi * (1.5 * i + 0.25) / STALLS
        yield Piece(f"churn {i}", _churn(), "chrome", _on_ring(angle, 4.25))
    for i, x in enumerate((-9.8, 9.8)):
        for k, y in enumerate((-6.0, 4.4)):
            yield from crates(rng, f"end {i} {k}", (x, y, 0.0))


def _churn() -> Mesh:
    """A milk churn."""
    return lathe([(0.17, 0.0), (0.18, 0.03), (0.18, 0.42), (0.1, 0.52), (0.1, 0.6), (0.13, 0.64), (0.13, 0.68)], 28)


def _signs(rng: Rng) -> Iterator[Piece]:
    """Banners from the ties, painted boards on the walls."""
    for i, (x, y) in enumerate(((-7.2, -3.0), (-7.2, 2.6), (7.2, -2.4), (7.2, 3.2), (-2.4, -5.4), (2.4, 5.3))):
        cloth = ("striped cloth", "blue cloth", "mustard cloth", "red plaid")[i % 4]
        yield Piece(f"banner {i}", moved(box(0.03, 0.9, 1.3), (0, 0, -1.3)), cloth, (x, y, EAVES - 0.9))
    for i, (subject, x) in enumerate((("coast", -6.6), ("meadow", 0.0), ("dawn", 6.6))):
        yield from picture(subject, 1.3, 0.9, (x, WIDTH / 2 - 0.2, 3.2), 0.0, f"board {i} ")
        yield from picture(subject, 1.3, 0.9, (-x, 0.2 - WIDTH / 2, 3.2), np.pi, f"far board {i} ")


def _lamps(rng: Rng) -> Iterator[Piece | Lamp]:
    for i in range(STALLS):
        place = _on_ring(2 * np.pi * (i + 0.5) / STALLS, 4.2, 2.75 + 0.25 * (i % 2))
        yield from hanging_lamp(f"lamp {i}", place, EAVES, 70.0)
    for i, (x, y) in enumerate((x, y) for x in (-8.8, 8.8) for y in (-4.0, 0.0, 4.0)):
        yield from hanging_lamp(f"end lamp {i}", (x, y, 2.9), EAVES, 60.0)
    for i, y in enumerate((-4.5, 4.5)):
        yield Lamp(f"skylight {i}", (0.0, y, EAVES - 0.1), 1050.0, (0.9, 0.96, 1.0), size=(19.0, 4.6))


OUTSIDE = Sky(
    zenith=(0.4, 0.5, 0.7),
    horizon=(0.8, 0.85, 0.9),
    ground=(0.3, 0.3, 0.3),
    glow=(0.0, 0.0, 0.0),
    clouds=(0.9, 0.9, 0.92),
    sun_direction=(0.3, 0.2, 0.9),
)
OUTWARD = Path(
    radius=1.9,
    radius_spread=0.4,
    height=1.65,
    height_spread=0.35,
    target=(0.0, 0.0, 1.9),  # above the eyes, so that they look a little down
    target_spread=0.3,
    waves=(3.0, 5.0),
    outward=True,
)
# Measured are 1.9; with these, rain costs a tenth to a fifth less here than its grade says.
MARKET = Design(make_market, OUTSIDE, OUTWARD, samples=14, clean_error=2.8)
