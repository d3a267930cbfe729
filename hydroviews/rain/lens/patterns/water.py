"""The water on a lens at a moment of the sequence of views: which drops are there, where, and how large.

Lengths are sides (the geometric mean of the picture's width and height) from the picture's upper left corner; y
is down. Everything is drawn at once for as many drops as there may ever be, and taken in that order, so that a
pattern with more drops has those of a pattern with fewer.
"""

from dataclasses import dataclass, field, replace
from functools import reduce

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from hydroviews.rain.lens.patterns.beads import Beads, draw_beads, joined, no_beads, untouched
from hydroviews.rain.lens.patterns.film import draw_film
from hydroviews.rain.lens.patterns.pattern import RaindropPattern
from hydroviews.rain.lens.patterns.runs import Rivulet, draw_rivulets, swept
from hydroviews.rain.lens.patterns.shapes import Outline
from hydroviews.rain.lens.patterns.window import WindowPattern
from hydroviews.scene.seeds import generator

Array = NDArray[np.float64]
MARGIN = 0.05  # drops may sit this far beyond the picture's edge, in widths and heights of it
CANDIDATES = 6000  # large drops that are tried, at most
GAP = 1.25  # drops are at first at least this many times the sum of their radii apart
TOUCH = 1.15  # and grow together at this distance
BULGE = 1.25  # an outline reaches this many radii of its disks, at most
LONGEST = 1.35  # the most that gravity stretches a drop
SMALLEST, LARGEST = 0.3, 3.5  # radii, in medians
MOST_DISKS = 3  # of a merged drop that keeps its form; more flow together into a round one


@dataclass(frozen=True)
class Drop:
    """One drop and its contact angle in radians."""

    outline: Outline
    contact_angle: float


@dataclass(frozen=True, eq=False)
class Water:
    """All that is on the lens at one moment."""

    drops: tuple[Drop, ...]
    rivulets: tuple[Rivulet, ...]
    droplets: Array  # [N, 4]: x, y, radius, contact angle
    beads: Beads = field(default_factory=no_beads)  # of a window


def water_at(pattern: RaindropPattern, extent: tuple[float, float], moment: float) -> Water:
    """The lens at a moment of the sequence of views.

    Args:
        pattern: the rain.
        extent: width and height of the picture in sides.
        moment: 0 at the first view, 1 at the last.
    """
    rivulets = draw_rivulets(pattern, extent, moment)
    drops = _grown(pattern, place_drops(pattern, extent), moment)
    kept: list[Drop] = []
    for drop in drops:
        hit = swept(rivulets, np.array(drop.outline.disks))
        if hit is None:
            kept.append(drop)
        else:
            rivulets[hit] = rivulets[hit].swallow(drop.outline.radius)
    merged = _merge(kept)
    taken = np.array([disk for drop in merged for disk in drop.outline.disks]).reshape(-1, 3)
    beads = np.concatenate([np.zeros((0, 4)), *(rivulet.beads for rivulet in rivulets)])
    if isinstance(pattern, WindowPattern):
        left = _free(beads, len(beads), taken, rivulets)
        return Water(tuple(merged), tuple(rivulets), left, _on_pane(pattern, extent, taken, left, rivulets))
    droplets = np.concatenate([beads, _droplets(pattern, extent)])
    return Water(tuple(merged), tuple(rivulets), _free(droplets, len(beads), taken, rivulets))


def _on_pane(
    pattern: WindowPattern, extent: tuple[float, float], taken: Array, left: Array, rivulets: list[Rivulet]
) -> Beads:
    """Film and beads of a window that no larger water touches, has swept away or has left behind."""
    film = draw_film(pattern, extent)
    beads = joined(film, draw_beads(pattern, extent, film))
    hiding = [taken * [1, 1, BULGE], left[:, :3]]
    for rivulet in rivulets:
        path, widths = rivulet.ribbon
        hiding.append(np.column_stack([path, 1.15 * widths]))
        hiding.append(np.column_stack([rivulet.way, np.full(len(rivulet.way), 0.9 * rivulet.start_radius)]))
    return beads[untouched(beads, np.concatenate(hiding))]


def place_drops(pattern: RaindropPattern, extent: tuple[float, float]) -> list[Drop]:
    """The large drops at the first view, none touching another, until they cover what is wanted."""
    drawn = _draw_candidates(pattern, extent)
    wanted = pattern.coverage * (1 + 2 * MARGIN) ** 2 * extent[0] * extent[1]
    disks, drops, covered = np.zeros((0, 3)), [], 0.0
    for candidate in drawn:
        if covered >= wanted:
            break
        mine = np.array(candidate.outline.disks)
        room = np.linalg.norm(disks[:, None, :2] - mine[None, :, :2], axis=-1)
        if np.all(room > GAP * (disks[:, None, 2] + mine[None, :, 2])):
            disks = np.concatenate([disks, mine])
            drops.append(candidate)
            covered += np.pi * candidate.outline.radius**2
    return drops


def _draw_candidates(pattern: RaindropPattern, extent: tuple[float, float]) -> list[Drop]:
    if pattern.coverage <= 0:
        return []
    rng = generator(pattern.seed, "drops")
    sides = np.array(extent)
    places = rng.uniform(-MARGIN, 1 + MARGIN, (CANDIDATES, 2)) * sides
    sizes = np.exp(pattern.radius_spread * rng.standard_normal(CANDIDATES))
    radii = pattern.radius_median * np.clip(sizes, SMALLEST, LARGEST)
    low, high = np.radians([pattern.contact_angle_min, pattern.contact_angle_max])
    angles = rng.uniform(low, high, CANDIDATES)
    waves = 0.06 * rng.standard_normal((CANDIDATES, 4)) / np.arange(1, 5) ** 1.3
    phases = rng.uniform(0, 2 * np.pi, (CANDIDATES, 4))
    pulls = rng.uniform(0.3, 1, CANDIDATES)
    neighbours = rng.choice(MOST_DISKS, CANDIDATES, p=(0.72, 0.2, 0.08))
    beside = rng.uniform(size=(CANDIDATES, MOST_DISKS - 1, 3))
    drops = []
    for i in range(CANDIDATES):
        disks = _cluster(places[i], radii[i], beside[i, : neighbours[i]])
        stretch = 1 + (LONGEST - 1) * float(pulls[i] * min((radii[i] / pattern.capillary_length) ** 2, 1))
        outline = Outline(disks, stretch, tuple(zip(waves[i].tolist(), phases[i].tolist(), strict=True)))
        drops.append(Drop(outline, float(angles[i])))
    return drops


def _cluster(place: Array, radius: float, beside: Array) -> tuple[tuple[float, float, float], ...]:
    """A disk, and disks that have run into it: direction, distance and size from uniform numbers [L, 3]."""
    disks = [(float(place[0]), float(place[1]), float(radius))]
    for direction, distance, size in beside.tolist():
        r, turn = radius * (0.45 + 0.4 * size), 2 * np.pi * direction
        far = (0.65 + 0.3 * distance) * (radius + r)
        disks.append((float(place[0] + far * np.cos(turn)), float(place[1] + far * np.sin(turn)), float(r)))
    return tuple(disks)


def _grown(pattern: RaindropPattern, drops: list[Drop], moment: float) -> list[Drop]:
    """Drops take up mist and spray from view to view, each at its own rate."""
    rates = generator(pattern.seed, "growth").uniform(0, pattern.growth, CANDIDATES)
    grown = []
    for drop, rate in zip(drops, rates, strict=False):
        disks = tuple((x, y, r * (1 + float(rate) * moment)) for x, y, r in drop.outline.disks)
        grown.append(replace(drop, outline=replace(drop.outline, disks=disks)))
    return grown


def _merge(drops: list[Drop]) -> list[Drop]:
    """Let drops that touch flow together, water kept, until none does."""
    while True:
        owner = np.repeat(np.arange(len(drops)), [len(drop.outline.disks) for drop in drops])
        disks = np.array([disk for drop in drops for disk in drop.outline.disks]).reshape(-1, 3)
        apart = np.linalg.norm(disks[:, None, :2] - disks[None, :, :2], axis=-1)
        touch = (apart < TOUCH * (disks[:, None, 2] + disks[None, :, 2])) & (owner[:, None] != owner[None, :])
        one, other = np.nonzero(touch)
        if len(one) == 0:
            return drops
        graph = coo_array((np.ones(len(one)), (owner[one], owner[other])), shape=(len(drops), len(drops)))
        count, group = connected_components(graph, directed=False)
        members: list[list[Drop]] = [[] for _ in range(count)]
        for drop, index in zip(drops, group, strict=True):
            members[index].append(drop)
        drops = [reduce(_united, parts) for parts in members]


def _united(drop: Drop, other: Drop) -> Drop:
    """The larger of two with the water of both; many disks become a round drop."""
    large, small = sorted((drop, other), key=lambda d: -d.outline.radius)
    disks = large.outline.disks + small.outline.disks
    if len(disks) > MOST_DISKS:
        both = replace(large.outline, disks=disks)
        disks = ((float(both.middle[0]), float(both.middle[1]), both.radius),)
    return replace(large, outline=replace(large.outline, disks=disks))


def _droplets(pattern: RaindropPattern, extent: tuple[float, float]) -> Array:
    rng = generator(pattern.seed, "droplets")
    count = pattern.droplets
    numbers = rng.standard_normal((count, 4))  # one row each, so that more droplets follow the same first ones
    uniform = generator(pattern.seed, "droplet places").uniform(size=(count, 3))
    places = (-MARGIN + (1 + 2 * MARGIN) * uniform[:, :2]) * np.array(extent)
    sizes = np.clip(np.exp(pattern.droplet_spread * numbers[:, 0]), SMALLEST, LARGEST)
    low, high = np.radians([pattern.contact_angle_min, pattern.contact_angle_max])
    return np.column_stack([places, pattern.droplet_median * sizes, low + (high - low) * uniform[:, 2]])


def _free(droplets: Array, beads: int, disks: Array, rivulets: list[Rivulet]) -> Array:
    """The droplets that touch no larger water and no earlier droplet; all but the first `beads` avoid trails too."""
    free = np.ones(len(droplets), bool)
    if len(disks):
        room = np.linalg.norm(droplets[:, None, :2] - disks[None, :, :2], axis=-1)
        free &= np.all(room > BULGE * disks[None, :, 2] + droplets[:, None, 2], axis=1)
    for rivulet in rivulets:
        free &= rivulet.clear_of_water(droplets)
        free[beads:] &= rivulet.clear_of_track(droplets[beads:])
    order = np.flatnonzero(free)
    if len(order) == 0:
        return np.zeros((0, 4))
    left = droplets[order]
    keep = np.ones(len(left), bool)
    pairs = cKDTree(left[:, :2]).query_pairs(2 * GAP * left[:, 2].max(), output_type="ndarray")
    for i, j in pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]:
        near = np.linalg.norm(left[i, :2] - left[j, :2]) < GAP * (left[i, 2] + left[j, 2])
        if near and keep[i] and keep[j]:
            keep[j] = False
    return left[keep]
