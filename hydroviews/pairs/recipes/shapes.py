"""Outlines and places of drops on a pane: a few large ones to thousands of beads, even, in patches or in columns."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hydroviews.pairs.recipes.fields import clouds, log_uniform

Array = NDArray[np.float64]
MEDIANS = (0.002, 0.004, 0.03)  # of the radii, in longer sides of the picture; half of them lie below 0.4 %
SPREADS = (0.1, 1.0)  # of the radii's logarithm
LARGEST = 0.05  # radius, in longer sides
SMALLEST = 0.4  # radius, pixels
COVERAGES = (0.015, 0.2, 0.6)  # share of the picture before drops without room are left out; half lie above 20 %
MOST = 5000  # drops
LARGER = 0.4  # share of the panes of small drops with a few larger ones among them
IN_COLUMNS = 0.2  # share of the panes
PATCHY = 0.6  # share of the others
TURNED = 0.25  # share of the panes whose drops point anywhere
TRIES = 8  # places drawn for a drop, where places are chosen


@dataclass(frozen=True, eq=False)
class Shapes:
    """Drops, the largest first; lengths in pixels."""

    middles: Array  # [N, 2], x and y
    radii: Array  # [N], of the round drop that covers as much
    aspects: Array  # [N], width over height before the turn
    turns: Array  # [N], radians
    waves: Array  # [N, 4], amplitudes of an outline's waves: cosine and sine, of two and of three periods


def draw_shapes(rng: np.random.Generator, width: int, height: int) -> Shapes:
    """The drops of one pane of so many pixels."""
    radii = _draw_radii(rng, width, height)
    count = len(radii)
    aspect = log_uniform(rng, 0.6, 3) if rng.uniform() < 0.5 else float(rng.uniform(0.8, 1.2))
    turns = rng.uniform(0, np.pi, count) if rng.uniform() < TURNED else rng.normal(0, 0.1, count)
    return Shapes(
        _draw_places(rng, count, width, height),
        radii,
        np.clip(aspect * np.exp(rng.uniform(0, 0.25) * rng.normal(size=count)), 0.6, 3),
        turns,
        np.clip(rng.uniform(0, 0.09) * rng.normal(size=(count, 4)), -0.15, 0.15),
    )


def _draw_radii(rng: np.random.Generator, width: int, height: int) -> Array:
    side = max(width, height)
    median, spread = _of_halves(rng, MEDIANS), log_uniform(rng, *SPREADS)
    each = np.pi * (median * side) ** 2 * np.exp(2 * spread**2)
    count = int(np.clip(_of_halves(rng, COVERAGES) * width * height / each, 3, MOST))
    radii = median * np.exp(spread * rng.normal(size=count))
    if median < 0.008 and rng.uniform() < LARGER:
        radii = np.concatenate([radii, rng.uniform(0.008, 0.025, int(rng.integers(3, 30)))])
    return np.sort(np.clip(radii * side, SMALLEST, LARGEST * side))[::-1]


def _of_halves(rng: np.random.Generator, limits: tuple[float, float, float]) -> float:
    """A number from the least to the most of three, with the one between as median."""
    return log_uniform(rng, *(limits[:2] if rng.uniform() < 0.5 else limits[1:]))


def _draw_places(rng: np.random.Generator, count: int, width: int, height: int) -> Array:
    """Middles [N, 2], evenly, in patches or in columns."""
    if rng.uniform() < IN_COLUMNS:
        return _in_columns(rng, count) * (width, height)
    if rng.uniform() > PATCHY:
        return rng.uniform(size=(count, 2)) * (width, height)
    field = clouds(rng, 60, 40, float(rng.uniform(2, 12)))
    density = np.clip(0.4 + rng.uniform(0.2, 1.5) * field, 0, 1)
    places = rng.uniform(size=(count, TRIES, 2))
    chance = density[(40 * places[..., 1]).astype(int), (60 * places[..., 0]).astype(int)]
    first = np.argmax(rng.uniform(size=(count, TRIES)) < chance, axis=1)
    return places[np.arange(count), first] * (width, height)


def _in_columns(rng: np.random.Generator, count: int) -> Array:
    """Places [N, 2] in shares of a pane's sides: vertical bands, or lines of beads, that wander a little."""
    bands = int(rng.integers(2, 25))
    begin = rng.uniform(-0.3, 0.4, bands)
    length = rng.uniform(0.3, 1.2, bands)
    which = rng.integers(bands, size=count)
    y = begin[which] + length[which] * rng.uniform(size=count)
    swing = 0.012 * np.sin(2 * np.pi * (rng.uniform(0.5, 2, bands)[which] * y + rng.uniform(size=bands)[which]))
    x = rng.uniform(size=bands)[which] + swing + log_uniform(rng, 0.001, 0.04) * rng.normal(size=count)
    loose = rng.uniform(size=count) < rng.uniform(0, 0.3)
    return np.where(loose[:, None], rng.uniform(size=(count, 2)), np.column_stack([x, y]))
