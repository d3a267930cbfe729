"""What stands about in `street`; everything is on the given place, its front or side at local -y."""

from collections.abc import Iterator

import numpy as np

from hydroviews.blender.embedded_scenes.meshes import Mesh, box, joined, lathe, moved, prism, rod, sphere
from hydroviews.blender.embedded_scenes.pieces import Lamp, Piece, Rng, Vector


def street_lamp(name: str, place: Vector, watts: float) -> Iterator[Piece | Lamp]:
    """A lantern on an iron post, 3.7 m high."""
    x, y, z = place
    post = lathe([(0.15, 0.0), (0.14, 0.3), (0.07, 0.5), (0.05, 3.1), (0.1, 3.2)], 16)
    bars = [
        rod((0.1 * c, 0.1 * s, 3.2), (0.18 * c, 0.18 * s, 3.62), 0.012) for c, s in ((1, 0), (0, 1), (-1, 0), (0, -1))
    ]
    cap = lathe([(0.24, 3.62), (0.1, 3.78), (0.02, 3.9)], 8, smooth=False)
    yield Piece(f"{name} post", joined(post, *bars, cap), "iron", place)
    yield Piece(f"{name} bulb", moved(sphere(0.13, 16, 24), (0, 0, 3.42)), "bulb", place)
    yield Lamp(name, (x, y, z + 3.42), watts, (1.0, 0.66, 0.32), radius=0.13)


def fairy_lights(rng: Rng, name: str, start: Vector, end: Vector) -> Iterator[Piece]:
    """A sagging cable with small lamps."""
    share = np.linspace(0, 1, 17)[:, None]
    sag = 0.7 * np.sin(np.pi * share) + rng.uniform(0, 0.05)
    points = np.array(start) + (np.array(end) - start) * share - sag * (0.0, 0.0, 1.0)
    yield Piece(f"{name} cable", joined(*map(_cable, points[:-1], points[1:])), "iron")
    bulbs = [moved(sphere(0.06, 8, 12), point - (0, 0, 0.08)) for point in points[1:-1]]
    yield Piece(f"{name} bulbs", joined(*bulbs), "bulb")


def _cable(start: np.ndarray, end: np.ndarray) -> Mesh:
    return rod(start, end, 0.012, 6)


def car(name: str, paint: str, place: Vector, turn: float) -> Iterator[Piece]:
    """A small old car, 3.4 m long, along x."""
    lower = [(-1.7, 0.3), (1.68, 0.3), (1.72, 0.55), (1.6, 0.78), (0.75, 0.9), (-1.35, 0.92), (-1.68, 0.75)]
    cabin = [(-1.3, 0.85), (0.85, 0.85), (0.3, 1.34), (0.1, 1.4), (-0.8, 1.4), (-1.02, 1.33)]
    glass = [(-1.12, 0.92), (0.66, 0.92), (0.22, 1.29), (-0.93, 1.29)]
    post = moved(box(0.07, 1.44, 0.5), (-0.32, 0, 0.9))
    yield Piece(name, joined(prism(lower, 1.5), prism(cabin, 1.4), post), paint, place, turn)
    screens = [prism([(0.86, 0.88), (0.84, 0.98), (0.4, 1.34), (0.36, 1.27)], 1.2), prism(glass, 1.43)]
    yield Piece(f"{name} windows", joined(*screens), "window", place, turn)
    wheels: list[Mesh] = []
    hubs: list[Mesh] = []
    for x in (-1.05, 1.05):
        for y in (-0.68, 0.68):
            for parts, radius, width in ((wheels, 0.31, 0.2), (hubs, 0.17, 0.22)):
                disc = lathe(
                    [(0.85 * radius, -width / 2), (radius, -width / 4), (radius, width / 4), (0.85 * radius, width / 2)]
                )
                parts.append(moved(disc, (x, y, 0.31), np.pi / 2, np.pi / 2))
    yield Piece(f"{name} wheels", joined(*wheels), "tyre", place, turn)
    fittings = [moved(box(0.08, 1.56, 0.12), (x, 0, 0.4)) for x in (-1.72, 1.74)]
    fittings += [moved(sphere(0.1, 12, 16), (1.66, y, 0.68)) for y in (-0.55, 0.55)]
    yield Piece(f"{name} fittings", joined(*hubs, *fittings), "chrome", place, turn)


def bicycle(name: str, paint: str, place: Vector, turn: float) -> Iterator[Piece]:
    """A bicycle, upright along x."""
    tyre = lathe([(0.31, -0.018), (0.34, -0.018), (0.34, 0.018), (0.31, 0.018)], 40, closed=True)
    wheels = [moved(tyre, (x, 0, 0.34), np.pi / 2, np.pi / 2) for x in (-0.52, 0.52)]
    spokes = [
        rod((x, 0, 0.34), (x + 0.32 * np.cos(a), 0, 0.34 + 0.32 * np.sin(a)), 0.005, 5)
        for x in (-0.52, 0.52)
        for a in np.arange(10) * np.pi / 5
    ]
    yield Piece(f"{name} wheels", joined(*wheels, *spokes), "tyre", place, turn)
    hub, pedals, saddle, head = (-0.52, 0, 0.34), (-0.08, 0, 0.32), (-0.22, 0, 0.82), (0.36, 0, 0.78)
    frame = [
        rod(a, b, 0.02) for a, b in ((hub, pedals), (hub, saddle), (pedals, saddle), (pedals, head), (saddle, head))
    ]
    frame += [rod((0.52, 0, 0.34), (0.32, 0, 0.98), 0.018), rod((0.32, -0.26, 1.0), (0.32, 0.26, 1.0), 0.016)]
    yield Piece(name, joined(*frame), paint, place, turn)
    yield Piece(f"{name} saddle", moved(box(0.26, 0.14, 0.06), (-0.24, 0, 0.84)), "oak", place, turn)
    yield Piece(f"{name} basket", moved(box(0.26, 0.34, 0.22), (0.52, 0, 0.8)), "yellow wood", place, turn)


def advertising_column(name: str, place: Vector) -> Iterator[Piece]:
    """A round pillar with posters under a dome."""
    body = lathe([(0.62, 0.0), (0.62, 0.35), (0.55, 0.4), (0.55, 2.5)], 48)
    yield Piece(name, body, "posters", place)
    dome = lathe([(0.55, 2.5), (0.72, 2.52), (0.72, 2.62), (0.5, 2.9), (0.2, 3.1), (0.06, 3.4), (0.02, 3.5)], 48)
    yield Piece(f"{name} dome", dome, "bronze", place)


def seat(name: str, place: Vector, turn: float) -> Iterator[Piece]:
    """A bench with a back."""
    wood = [moved(box(1.6, 0.12, 0.05), (0, y, 0.45)) for y in (-0.18, -0.02, 0.14)]
    wood += [moved(box(1.6, 0.05, 0.12), (0, 0.25, z)) for z in (0.6, 0.8)]
    yield Piece(name, joined(*wood), "oak", place, turn)
    legs = [rod((x, y, 0), (x, 0.9 * y, h), 0.03) for x in (-0.65, 0.65) for y, h in ((-0.2, 0.46), (0.24, 0.95))]
    yield Piece(f"{name} legs", joined(*legs), "iron", place, turn)
