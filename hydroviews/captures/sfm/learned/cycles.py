"""Pairs of views that contradict the others: by way of a third view, their features have other partners."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from hydroviews.captures.sfm.features import Features
from hydroviews.captures.sfm.learned.stationary import Matches
from hydroviews.captures.sfm.pairs import Pair

AGREED = 0.5  # share of the cycles of a pair that have to close
FEWEST = 10  # cycles that say anything


def contradicted(views: Sequence[Features], matches: Matches, error: float) -> set[Pair]:
    """Pairs of whose cycles through a third view most do not close.

    Args:
        views: the features of each.
        matches: verified ones, for every pair.
        error: pixels by which both ways may end apart.
    """
    partners = partner_tables(views, matches)
    found = set()
    for pair in matches:
        closed, cycles = closed_cycles(views, partners, pair, error)
        if cycles >= FEWEST and closed < AGREED * cycles:
            found.add(pair)
    return found


def partner_tables(views: Sequence[Features], matches: Matches) -> dict[Pair, NDArray[np.int64]]:
    """For each pair, in both orders, the partner of every feature [K] of the first view; -1 for none."""
    partners: dict[Pair, NDArray[np.int64]] = {}
    for (i, j), found in matches.items():
        for own, other, columns in ((i, j, found), (j, i, found[:, ::-1])):
            table = np.full(len(views[own]), -1, np.int64)
            table[columns[:, 0]] = columns[:, 1]
            partners[own, other] = table
    return partners


def closed_cycles(
    views: Sequence[Features], partners: Mapping[Pair, NDArray[np.int64]], pair: Pair, error: float
) -> tuple[int, int]:
    """How many matches of a pair are confirmed by way of third views, and how many of them have such a way."""
    first, second = pair
    closed = cycles = 0
    direct = partners[pair]
    for third in range(len(views)):
        if (first, third) not in partners or (third, second) not in partners:
            continue
        between = partners[first, third]
        around = np.where(between >= 0, partners[third, second][between], -1)
        both = (around >= 0) & (direct >= 0)
        places = views[second].keypoints[:, :2]
        apart = np.linalg.norm(places[around[both]] - places[direct[both]], axis=1)
        closed, cycles = closed + int((apart <= error).sum()), cycles + int(both.sum())
    return closed, cycles
