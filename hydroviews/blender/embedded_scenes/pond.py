"""The embedded scene `pond`: a garden around a pond, late in the afternoon; cameras go around it on a gravel walk."""

from collections.abc import Iterator

import numpy as np

from hydroviews.blender.embedded_scenes.camera_paths import Path
from hydroviews.blender.embedded_scenes.foliage import blades, hedge, reeds, shrub, tree
from hydroviews.blender.embedded_scenes.meshes import annulus, box, joined, lathe, lumpy, moved, rod, sphere
from hydroviews.blender.embedded_scenes.objects import bench, pot, rock, vase
from hydroviews.blender.embedded_scenes.pieces import Design, Piece, Rng, Sky, Vector

SHORE = 3.0  # metres from the pond's centre, on average
WATER = -0.12  # metres: its surface
WALK = (5.7, 7.3)  # the gravel's inner and outer radius; cameras are above it
STEPS = 120  # of the ground, around


def make_pond(rng: Rng) -> list[Piece]:
    """All pieces; the same generator state gives the same garden."""
    parts = (_ground, _water, _bank, _grass, _island, _jetty, _lantern, _beds, _hedges, _trees, _pavilion, _woods)
    return [piece for part, child in zip(parts, rng.spawn(len(parts)), strict=True) for piece in part(child)]


def _shore(angle: np.ndarray | float) -> np.ndarray:
    """How far from the centre the bank is, in each direction."""
    return SHORE * (1 + 0.1 * np.sin(2 * np.asarray(angle) + 0.4) + 0.06 * np.sin(3 * np.asarray(angle) + 1.0))


def _on_ring(angle: float, radius: float, height: float = 0.0) -> Vector:
    return radius * float(np.cos(angle)), radius * float(np.sin(angle)), height


def _ground(rng: Rng) -> Iterator[Piece]:
    angles = np.linspace(0, 2 * np.pi, STEPS, endpoint=False)
    shore = _shore(angles)
    radii = [0.3, 1.0, 1.8, 2.4, 2.7, 3.0, 3.3, 3.6, 4.2, 5.0, 5.6, 7.4, 8.0, 9.5, 12.0, 16.0, 24.0]
    bed = [np.interp(radius / shore, [0.5, 0.9, 1.06, 1.25], [-0.6, -0.4, -0.05, 0.04]) for radius in radii[:9]]
    meadow = [0.04, -0.05, -0.05, 0.06, 0.15, 0.2, 0.6, 1.6]
    heights = np.vstack([*bed, *(np.full(STEPS, z) for z in meadow)]) + 0.015 * rng.standard_normal((17, STEPS))
    yield Piece("lawn", annulus(radii, heights), "meadow grass")
    walk = np.outer([-0.1, 0.02, 0.03, 0.02, -0.1], np.ones(STEPS))
    yield Piece("walk", annulus([WALK[0] - 0.1, WALK[0], 6.5, WALK[1], WALK[1] + 0.1], walk), "gravel")


def _water(rng: Rng) -> Iterator[Piece]:
    yield Piece("water", lathe([(1.3 * SHORE, WATER - 0.02), (1.3 * SHORE, WATER)], STEPS, smooth=False), "water")
    pads, flowers = [], []
    for angle, radius in ((0.6, 1.9), (2.3, 1.7), (5.2, 2.0)):
        for _ in range(9):
            x, y, _z = _on_ring(angle + rng.normal(0, 0.22), radius + rng.normal(0, 0.3))
            size = rng.uniform(0.13, 0.24)
            pads.append(moved(lathe([(size, 0.0), (size, 0.012)], 14, smooth=False), (x, y, WATER)))
            if rng.random() < 0.35:
                petals = lathe([(0.03, 0.0), (0.09, 0.05), (0.07, 0.1), (0.02, 0.06)], 7, smooth=False)
                flowers.append(moved(petals, (x, y, WATER + 0.012)))
    yield Piece("lily pads", joined(*pads), "lily pad")
    yield Piece("lilies", joined(*flowers), "flowers")


def _bank(rng: Rng) -> Iterator[Piece]:
    """Stones along the water, and reeds between them."""
    for i in range(44):
        angle = 2 * np.pi * (i + rng.uniform(-0.3, 0.3)) / 44
        size = rng.uniform(0.1, 0.3)
        stone = lumpy(sphere(size, 20, 28), rng, 0.3 * size, 1.4 / size)
        yield Piece(f"stone {i}", stone, "stone", _on_ring(angle, float(_shore(angle)) * rng.uniform(1.0, 1.12), -0.08))
    for i, angle in enumerate((0.25, 0.5, 1.5, 2.75, 3.0, 3.25, 4.4, 5.7)):
        yield from reeds(rng, f"reeds {i}", _on_ring(angle, 0.94 * float(_shore(angle)), -0.2), rng.uniform(0.9, 1.3))


def _grass(rng: Rng) -> Iterator[Piece]:
    """Tufts on the lawn inside the walk; the pond's bank and the gravel stay free."""
    angle, share = rng.uniform(0, 2 * np.pi, 420), rng.uniform(0, 1, 420)
    radius = 1.22 * _shore(angle) + share * (WALK[0] - 0.35 - 1.22 * _shore(angle))
    centres = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(420)])
    feet = np.repeat(centres, 14, axis=0) + rng.normal(0, 0.07, (420 * 14, 3)) * (1, 1, 0)
    yield Piece("grass", blades(rng, feet, 0.26, 0.026), "reed")
    daisies = centres[::3] + np.array([0.1, 0.0, 0.2])
    heads = [moved(lumpy(sphere(0.045, 7, 9), rng, 0.01, 20.0), place) for place in daisies]
    yield Piece("daisies", joined(*heads), "flowers")


def _island(rng: Rng) -> Iterator[Piece]:
    """What the cameras look at: an island with a bare tree, a shrub and a stone."""
    land = lumpy(lathe([(0.95, -0.6), (0.9, -0.1), (0.7, 0.08), (0.3, 0.16)], 40), rng, 0.06, 2.5)
    yield Piece("island", land, "meadow grass", (-0.3, 0.1, 0.0))
    yield from tree(rng, "bare tree", (-0.45, 0.2, 0.1), 3.2, "foliage", "birch bark", leaf=0.0)
    yield from shrub(rng, "island shrub", (0.05, -0.3, 0.02), 0.6, "red leaf")
    yield from rock(rng, "island", (-0.8, -0.35, 0.0))


def _jetty(rng: Rng) -> Iterator[Piece]:
    """Boards on posts from the bank towards the island, with a rail on one side."""
    boards = [moved(box(0.17, 1.0, 0.05), (0.19 * k, 0, 0.16), turn=rng.normal(0, 0.01)) for k in range(12)]
    posts = [rod((x, y, -0.6), (x, y, 0.95 if y > 0 else 0.2), 0.045) for x in (0.1, 1.1, 2.0) for y in (-0.45, 0.45)]
    rail = rod((0.05, 0.45, 0.88), (2.1, 0.45, 0.92), 0.03)
    place, turn = _on_ring(-1.0, 1.75), -1.0
    yield Piece("jetty", joined(*boards), "oak", place, turn)
    yield Piece("jetty posts", joined(*posts, rail), "bark", place, turn)
    yield Piece("bucket", lathe([(0.1, 0.0), (0.14, 0.26), (0.12, 0.26)], 20), "chrome", _on_ring(-0.98, 2.3, 0.21))


def _lantern(rng: Rng) -> Iterator[Piece]:
    """A stone lantern on the bank, and a jar across the water."""
    foot = lathe([(0.3, -0.1), (0.3, 0.1), (0.13, 0.2), (0.11, 0.75), (0.3, 0.85), (0.3, 0.92)], 8, smooth=False)
    yield Piece("lantern foot", foot, "stone", _on_ring(1.05, 4.1))
    house = joined(*(moved(box(0.09, 0.09, 0.34), (x, y, 0.92)) for x in (-0.15, 0.15) for y in (-0.15, 0.15)))
    yield Piece("lantern house", house, "stone", _on_ring(1.05, 4.1))
    roof = lathe([(0.46, 1.26), (0.42, 1.34), (0.14, 1.52), (0.06, 1.66), (0.02, 1.7)], 8, smooth=False)
    yield Piece("lantern roof", roof, "stone", _on_ring(1.05, 4.1))
    yield Piece("jar", vase(0.8), "blue tiles", _on_ring(3.7, 4.3))
    yield from bench(rng, "bank", _on_ring(4.95, 4.6))
    yield from pot(rng, "bank", _on_ring(2.1, 4.5))


def _beds(rng: Rng) -> Iterator[Piece]:
    """Shrubs and flowers outside of the walk."""
    kinds = ("foliage", "blossom", "red leaf", "foliage", "yellow leaf")
    for i in range(22):
        angle = 2 * np.pi * (i + rng.uniform(-0.25, 0.25)) / 22
        place = _on_ring(angle, rng.uniform(8.5, 9.3), 0.05)
        yield from shrub(rng, f"shrub {i}", place, rng.uniform(0.9, 1.5), kinds[i % len(kinds)])


def _hedges(rng: Rng) -> Iterator[Piece]:
    for i in range(14):
        angle = 2 * np.pi * (i + 0.5) / 14
        if i not in (3, 9):  # the ways in
            yield from hedge(
                rng, f"hedge {i}", _on_ring(angle, 11.2, 0.1), angle + np.pi / 2, 4.6, rng.uniform(1.2, 1.7)
            )


def _trees(rng: Rng) -> Iterator[Piece]:
    kinds = ("foliage", "yellow leaf", "foliage", "red leaf", "foliage")
    for i in range(10):
        angle = 2 * np.pi * (i + rng.uniform(-0.2, 0.2)) / 10
        place = _on_ring(angle, rng.uniform(12.8, 14.5), 0.1)
        bark = ("bark", "birch bark")[i % 2]
        yield from tree(rng, f"tree {i}", place, rng.uniform(5.0, 6.8), kinds[i % len(kinds)], bark, leaf=0.3)


def _pavilion(rng: Rng) -> Iterator[Piece]:
    """An open summer house, seen above the beds from across the water."""
    place, turn = _on_ring(2.0, 10.6, 0.1), 2.0
    posts = [rod((x, y, 0.2), (x, y, 2.3), 0.07) for x in (-1.0, 1.0) for y in (-1.0, 0.0, 1.0)]
    rails = [moved(box(0.06, 2.0, 0.08), (x, 0, z)) for x in (-1.0, 1.0) for z in (0.5, 0.95)]
    yield Piece("pavilion floor", box(2.5, 2.5, 0.22), "stone", place, turn)
    yield Piece("pavilion wood", joined(*posts, *rails), "painted wood", place, turn)
    roof = lathe([(1.9, 2.25), (1.85, 2.35), (0.9, 3.1), (0.1, 3.7)], 4, smooth=False)
    yield Piece("pavilion roof", roof, "red roof", place, turn + np.pi / 4)


def _woods(rng: Rng) -> Iterator[Piece]:
    """What closes the view behind the garden."""
    yield Piece("land", annulus([20.0, 40.0, 70.0], np.outer([1.0, 3.0, 9.0], np.ones(48))), "hill")
    for i in range(30):
        place = _on_ring(2 * np.pi * (i + rng.uniform(-0.3, 0.3)) / 30, rng.uniform(18.0, 22.0), rng.uniform(0.2, 0.8))
        kind = ("foliage", "foliage", "yellow leaf", "foliage", "red leaf")[i % 5]
        yield from shrub(rng, f"wood {i}", place, rng.uniform(5.0, 7.5), kind, leaf=0.5)


AFTERNOON = Sky(
    zenith=(0.34, 0.54, 0.95),
    horizon=(1.05, 1.02, 0.96),
    ground=(0.36, 0.38, 0.28),
    glow=(0.5, 0.36, 0.18),
    clouds=(1.1, 1.06, 1.0),
    sun_direction=(-0.7, 0.3, 0.62),
    sun_strength=5.4,
    sun_colour=(1.0, 0.86, 0.66),
)
ON_THE_WALK = Path(
    radius=6.5,
    radius_spread=0.5,
    height=1.9,
    height_spread=0.9,
    target=(0.0, 0.0, 0.75),
    target_spread=0.35,
    waves=(3.0, 2.0),
)
POND = Design(make_pond, AFTERNOON, ON_THE_WALK, samples=16)
