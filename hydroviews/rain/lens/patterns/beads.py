"""Beads: small drops by the thousand, with irregular outlines, scattered where a density field lets them lie."""

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from hydroviews.rain.lens.patterns.fields import smooth_field
from hydroviews.rain.lens.patterns.window import WindowPattern
from hydroviews.scene.seeds import generator

Array = NDArray[np.float64]
FINE = 1400  # cells in a side, of the grid on which beads keep apart
MARGIN = 0.03  # beads may sit this far beyond the picture's edge, in widths and heights of it
TRIES = 24  # places that are tried for a bead; one without a place is left out
APART = 1.08  # a bead is this many times as large while it looks for a place
SMALLEST, LARGEST = 0.2, 6.0  # radii, in medians
WAVES = 4  # periods 2 to 5 of an outline
JITTER = 0.12  # spread of the aspect's logarithm


@dataclass(frozen=True, eq=False)
class Beads:
    """Small drops; lengths in sides."""

    places: Array  # [N, 2]
    radii: Array  # [N], of the round drop that covers as much
    angles: Array  # [N], contact angles, radians
    aspects: Array  # [N], width over height
    waves: Array  # [N, WAVES, 2], amplitudes and phases of the outline's waves of 2, 3, ... periods

    def __len__(self) -> int:
        return len(self.radii)

    def __getitem__(self, which: NDArray) -> "Beads":
        return Beads(*(part[which] for part in vars(self).values()))

    @property
    def disks(self) -> Array:
        """[N, 3]: x, y, radius."""
        return np.column_stack([self.places, self.radii])


def no_beads() -> Beads:
    """None at all."""
    return Beads(np.zeros((0, 2)), np.zeros(0), np.zeros(0), np.zeros(0), np.zeros((0, WAVES, 2)))


def joined(*parts: Beads) -> Beads:
    """All beads together."""
    return Beads(*(np.concatenate(columns) for columns in zip(*(vars(part).values() for part in parts), strict=True)))


def draw_beads(pattern: WindowPattern, extent: tuple[float, float], taken: Beads) -> Beads:
    """The pattern's beads, the largest placed first.

    Args:
        pattern: the pane.
        extent: width and height of the picture in sides.
        taken: beads that are there already.
    """
    field = smooth_field(generator(pattern.seed, "patches"), extent, (3, 8))
    crowded = np.clip(0.45 + 0.45 * (field - field.mean()) / field.std(), 0, 1) ** 1.5  # a sixth of the pane is free
    density = 1 - pattern.patches * (1 - crowded)
    radii = log_normal(
        generator(pattern.seed, "beads"), pattern.droplets, pattern.droplet_median, pattern.droplet_spread
    )
    shapes = (pattern.bead_aspect, pattern.bead_wave)
    return scattered(generator(pattern.seed, "bead places"), radii, density, extent, shapes, pattern, taken)


def log_normal(rng: np.random.Generator, count: int, median: float, spread: float) -> Array:
    """So many radii, the largest first; those of the lowest and highest few per cent are brought in."""
    sizes = np.exp(spread * rng.standard_normal(count))
    return np.sort(median * np.clip(sizes, SMALLEST, LARGEST))[::-1]


def scattered(
    rng: np.random.Generator,
    radii: Array,
    density: Array,
    extent: tuple[float, float],
    shapes: tuple[float, float],
    pattern: WindowPattern,
    taken: Beads,
) -> Beads:
    """Beads of given radii [N], none touching another, more of them where a field is high.

    Args:
        rng: the generator.
        radii: the largest first.
        density: [R, C] over the picture, the chance that a place is taken if it is free.
        extent: width and height of the picture in sides.
        shapes: the aspect of their outlines, and the amplitude of their waves.
        pattern: the pane, for contact angles.
        taken: beads to keep clear of.
    """
    count = len(radii)
    unit = (-MARGIN + (1 + 2 * MARGIN) * rng.uniform(size=(count, TRIES, 2))).astype(np.float64)
    rows, columns = density.shape
    row = np.clip((unit[..., 1] * rows).astype(int), 0, rows - 1)
    column = np.clip((unit[..., 0] * columns).astype(int), 0, columns - 1)
    wanted = rng.uniform(size=(count, TRIES)) < density[row, column]
    places = unit * np.array(extent)
    aspects = shapes[0] * np.exp(JITTER * rng.standard_normal(count))
    amplitudes = shapes[1] * rng.standard_normal((count, WAVES)) / np.arange(1, WAVES + 1) ** 0.5
    waves = np.stack([np.clip(amplitudes, -0.3, 0.3), rng.uniform(0, 2 * np.pi, (count, WAVES))], axis=-1)
    low, high = np.radians([pattern.contact_angle_min, pattern.contact_angle_max])
    angles = rng.uniform(low, high, count)
    grid = np.zeros([int(np.ceil(FINE * (1 + 2 * MARGIN) * side)) + 1 for side in extent[::-1]], np.bool_)
    origin = MARGIN * np.array(extent)
    for disk, aspect in zip(taken.disks, taken.aspects, strict=True):
        _is_free(grid, FINE * (disk[:2] + origin), FINE * disk[2], aspect, True)
    chosen = _throw(grid, FINE * (places + origin), wanted, FINE * radii, aspects)
    found = np.flatnonzero(chosen >= 0)
    return Beads(places[found, chosen[found]], radii[found], angles[found], aspects[found], waves[found])


def untouched(beads: Beads, disks: Array) -> NDArray[np.bool_]:
    """Which beads [N] none of some disks [L, 3] touches."""
    return _untouched(beads.disks, np.ascontiguousarray(disks, np.float64))


@numba.njit(cache=True, nogil=True)
def _untouched(beads: Array, disks: Array) -> NDArray[np.bool_]:
    free = np.ones(len(beads), np.bool_)
    for i in range(len(beads)):
        for j in range(len(disks)):
            across, down = beads[i, 0] - disks[j, 0], beads[i, 1] - disks[j, 1]
            near = beads[i, 2] + disks[j, 2]
            if across * across + down * down < near * near:
                free[i] = False
                break
    return free


@numba.njit(cache=True, nogil=True)
def _throw(grid, places, wanted, radii, aspects):  # type: ignore[no-untyped-def]
    """Which of its places [N, T] each ellipse takes on a grid of cells; -1 for none."""
    chosen = np.full(len(radii), -1, np.int64)
    for i in range(len(radii)):
        for t in range(wanted.shape[1]):
            if wanted[i, t] and _is_free(grid, places[i, t], APART * radii[i] + 0.5, aspects[i], False):
                _is_free(grid, places[i, t], radii[i], aspects[i], True)
                chosen[i] = t
                break
    return chosen


@numba.njit(cache=True, nogil=True)
def _is_free(grid, place, radius, aspect, take):  # type: ignore[no-untyped-def]
    """True if an ellipse of cells is free. With `take` all its cells are taken instead, free or not."""
    wide, high = radius * np.sqrt(aspect), radius / np.sqrt(aspect)
    for y in range(max(0, int(place[1] - high)), min(grid.shape[0], int(place[1] + high) + 2)):
        for x in range(max(0, int(place[0] - wide)), min(grid.shape[1], int(place[0] + wide) + 2)):
            if ((x - place[0]) / wide) ** 2 + ((y - place[1]) / high) ** 2 <= 1:
                if take:
                    grid[y, x] = True
                elif grid[y, x]:
                    return False
    return True
