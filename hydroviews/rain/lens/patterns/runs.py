"""Drops that run down the lens: their way, the water they drag behind them, and the beads they leave.

A drop runs when its weight exceeds what the difference of the contact angles below and above can hold. It drags a
tail of water that thins upwards; where the tail is too thin it breaks up into beads (Rayleigh and Plateau), and on its
way it takes up every drop it meets and wipes off the mist.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from hydroviews.rain.lens.patterns.pattern import TAIL, RaindropPattern
from hydroviews.scene.seeds import generator

Array = NDArray[np.float64]
CANDIDATES = 40  # runs that are tried, at most
STEP = 0.004  # between points of a way, in sides
LEAVES = 0.5  # of the water it takes up, a running drop keeps this share; the tail has the rest
FATTEST = 1.4  # the most that a running drop grows, in radii


@dataclass(frozen=True, eq=False)
class Rivulet:
    """One running drop at a moment; lengths in sides."""

    way: Array  # [N, 2], all that it has run so far, from where it began
    start_radius: float
    radius: float  # of its head
    contact_angle: float  # radians
    seed: int  # of its beads
    tail: float = TAIL  # length of the unbroken tail, in radii of the drop

    def swallow(self, radius: float) -> "Rivulet":
        """The rivulet after it took up a drop."""
        grown = np.cbrt(self.radius**3 + LEAVES * radius**3)
        return replace(self, radius=float(min(grown, FATTEST * self.start_radius)))

    @cached_property
    def ribbon(self) -> tuple[Array, Array]:
        """Path [N, 2] and half widths [N] of its unbroken water, from the tail's tip to the head's front."""
        length = STEP * (len(self.way) - 1)
        tail = max(min(self.tail * self.radius, length), 1.2 * self.radius)
        behind = np.concatenate([
            np.linspace(tail, self.radius, round(40 * max(self.tail / TAIL, 1)), endpoint=False),
            self.radius * np.cos(np.linspace(0, np.pi, 32)),
        ])  # fmt: skip
        path = self._at(length - behind)
        head = np.sqrt(np.maximum(self.radius**2 - behind**2, 0))
        neck = self.radius * (0.2 + 0.6 * np.exp(-np.maximum(behind, 0) / (1.2 * self.radius)))
        thin = neck * np.sqrt(np.clip((tail - behind) / (0.5 * self.radius), 0, 1))
        trailing = np.where(behind > 0, thin, 0)
        return path, np.maximum(np.maximum(head, trailing), 0.06 * self.radius)

    @cached_property
    def beads(self) -> Array:
        """What is left of its tail, [B, 4]: x, y, radius, contact angle."""
        rng = generator(self.seed, "beads")
        steps = self.start_radius * rng.uniform(0.45, 1.6, 400)
        sizes = self.start_radius * np.clip(0.17 * np.exp(0.35 * rng.standard_normal(400)), 0.06, 0.3)
        aside = 0.12 * self.start_radius * rng.standard_normal(400)
        along = np.cumsum(steps)
        places = self._at(along) + np.column_stack([aside, np.zeros(400)])
        beads = np.column_stack([places, sizes, np.full(400, 0.8 * self.contact_angle)])
        return beads[along < STEP * (len(self.way) - 1) - (self.tail + 1) * self.radius]

    def clear_of_water(self, droplets: Array) -> NDArray[np.bool_]:
        """Which droplets [N, 4] its unbroken water does not touch."""
        path, widths = self.ribbon
        room = np.linalg.norm(droplets[:, None, :2] - path[None], axis=-1)
        return np.all(room > 1.15 * widths + droplets[:, None, 2] + STEP, axis=1)

    def clear_of_track(self, droplets: Array) -> NDArray[np.bool_]:
        """Which droplets [N, 4] it has not wiped off."""
        room = np.linalg.norm(droplets[:, None, :2] - self.way[None], axis=-1)
        return np.all(room > 0.9 * self.start_radius + droplets[:, None, 2], axis=1)

    def _at(self, length: Array) -> Array:
        """Points [N, 2] at lengths along the way, straight up and down beyond its ends."""
        last = STEP * (len(self.way) - 1)
        inside = np.clip(length, 0, last)
        points = [np.interp(inside, STEP * np.arange(len(self.way)), self.way[:, axis]) for axis in (0, 1)]
        return np.column_stack([points[0], points[1] + length - inside])


def draw_rivulets(pattern: RaindropPattern, extent: tuple[float, float], moment: float) -> list[Rivulet]:
    """The pattern's running drops at a moment, 0 the first view, 1 the last, but those that would meet another."""
    rng = generator(pattern.seed, "rivulets")
    uniform, waves = rng.uniform(size=(CANDIDATES, 6)), rng.uniform(size=(CANDIDATES, 3, 2))
    low, high = np.radians([pattern.contact_angle_min, pattern.contact_angle_max])
    scale, tail = pattern.runs
    chosen: list[Rivulet] = []
    lanes: list[tuple[float, float]] = []
    for i in range(CANDIDATES):
        if len(chosen) == pattern.rivulets:
            break
        x, begin, total, before, size, angle = uniform[i].tolist()
        radius = scale * (1.7 + size)
        middle, reach = x * extent[0], 3 * radius + 0.02
        if any(abs(middle - other) < reach + theirs for other, theirs in lanes):
            continue
        lanes.append((middle, reach))
        run = (0.25 + 0.6 * total) * extent[1]
        done = run * (0.35 + 0.4 * before + (0.65 - 0.4 * before) * moment)
        way = _way(middle, (1.1 * begin - 0.3) * extent[1], run, done, radius, waves[i])
        chosen.append(Rivulet(way, radius, radius, low + (high - low) * angle, pattern.seed + i, tail))
    return chosen


def _way(x: float, y: float, run: float, done: float, radius: float, waves: Array) -> Array:
    """Down from (x, y), meandering; the first `done` of a run, so that a longer one continues it."""
    t = STEP * np.arange(max(2, int(min(done, run) / STEP) + 1))
    aside = np.zeros(len(t))
    for k, (size, phase) in enumerate(waves, start=1):
        period = 26 * radius / k
        aside += 0.9 * radius * size / k * (np.sin(2 * np.pi * (t / period + phase)) - np.sin(2 * np.pi * phase))
    return np.column_stack([x + aside, y + t])


def swept(rivulets: list[Rivulet], disks: Array) -> int | None:
    """The index of the first rivulet whose way or head touches a drop made of `disks` [L, 3]; None if none does."""
    for i, rivulet in enumerate(rivulets):
        head = np.concatenate([rivulet.way, rivulet.ribbon[0]])
        room = np.linalg.norm(head[:, None] - disks[None, :, :2], axis=-1)
        if np.any(room < FATTEST * rivulet.start_radius + 1.1 * disks[None, :, 2]):
            return i
    return None
