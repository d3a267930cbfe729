"""When drops come and go on a lens of which a share is renewed from view to view.

Every view brings a *generation*: the drops of one of a few lenses, all moved by the same way. In the first view all of
them are there; later each is born with the probability of the share, and from view to view each leaves with the same,
so that as many are on the lens at all times. Whoever has no room waits until older water leaves; droplets give way to
large drops. What is on the lens in a view follows from the seed and the view's number alone, without looking at
earlier views.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hydroviews.rain.lens.patterns.bodies import Bodies, find_room
from hydroviews.rain.lens.patterns.pattern import RaindropPattern
from hydroviews.scene.seeds import generator

LENSES = 4  # in the bank
SHIFT = 0.1  # widths and heights that a generation may be moved to either side
RARE = 1e-6  # a life is not longer than what so small a share of the drops reach
CROWDING = 10.0  # area in which a drop hinders others, over its own: keeps the cover, within 13 %, at all shares


@dataclass(frozen=True, eq=False)
class Generation:
    """What is left of the drops that a view brought."""

    birth: int  # number of the view
    lens: int  # of the bank
    shift: tuple[float, float]  # right and down, in widths and heights of the picture
    slots: NDArray[np.int64]  # which bodies of that lens


@dataclass(frozen=True, eq=False)
class Lives:
    """The lives of all drops in front of a capture."""

    bank: Sequence[Bodies]  # of each lens of the bank, in pictures' widths and heights times `sides`
    sides: tuple[float, float]  # width and height of the picture, in sides
    last: NDArray[np.int32]  # [views, S]: number of the last view of each body of each generation; -1: never born
    shifts: NDArray[np.float64]  # [views, 2]

    def at(self, view: int) -> list[Generation]:
        """What is on the lens in a view, the oldest first."""
        births, slots = np.nonzero(self.last[: view + 1] >= view)
        lens = births % len(self.bank)
        large = np.array([bodies.large for bodies in self.bank])[lens] > slots
        order = np.argsort(~large, kind="stable")  # droplets last, each kind by age
        births, slots = births[order], slots[order]
        there = find_room(*self._disks(births, slots), births)
        births, slots = births[there], slots[there]
        return [
            Generation(int(j), int(j) % len(self.bank), (float(self.shifts[j, 0]), float(self.shifts[j, 1])), mine)
            for j in np.unique(births)
            if len(mine := slots[births == j])
        ]

    def _disks(self, births: NDArray, slots: NDArray) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """The disks of bodies where their generations are, and where each body's begin."""
        first = np.cumsum([0, *(len(bodies.disks) for bodies in self.bank)])
        starts = np.concatenate([bodies.starts[:-1] + at for bodies, at in zip(self.bank, first, strict=False)])
        bodies_before = np.cumsum([0, *map(len, self.bank)])
        body = bodies_before[births % len(self.bank)] + slots
        counts = np.diff([*starts, first[-1]])[body]
        begin = np.cumsum([0, *counts])
        index = np.arange(begin[-1]) + np.repeat(starts[body] - begin[:-1], counts)
        disks = np.concatenate([bodies.disks for bodies in self.bank])[index]
        disks[:, :2] += np.repeat(self.shifts[births] * self.sides, counts, axis=0)
        return disks, begin


def draw_lives(pattern: RaindropPattern, bank: Sequence[Bodies], sides: tuple[float, float], views: int) -> Lives:
    """Draw when each drop comes and goes, and where each generation sits.

    Args:
        pattern: its seed, the share of renewed drops, the coverage.
        bank: the bodies of its lenses.
        sides: width and height of the picture in sides.
        views: how many there are; the first ones are the same for any number.
    """
    share, most = pattern.renewed, max(map(len, bank))
    crowded = 1 + CROWDING * (1 - share) * pattern.coverage  # large drops that wait for room are made up for
    last = np.full((views, most), -1, np.int32)
    shifts = np.zeros((views, 2))
    for birth in range(views):
        rng = generator(pattern.seed, "generation", birth)
        shifts[birth] = SHIFT * rng.uniform(-1, 1, 2)
        bodies = bank[birth % len(bank)]
        born, life = rng.uniform(size=(2, len(bodies)))
        chance = np.full(len(bodies), float(share))
        chance[: bodies.large] *= crowded
        more = np.zeros(len(bodies)) if share == 1 else np.log(np.maximum(life, RARE)) / np.log1p(-share)
        end = birth + np.minimum(more, views).astype(np.int32)
        last[birth, : len(bodies)] = np.where((birth == 0) | (born < chance), end, -1)
    return Lives(bank, sides, last, shifts)
