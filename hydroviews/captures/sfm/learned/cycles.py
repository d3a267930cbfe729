"""Pairs of views that others do not confirm: by way of a third view, their features have other partners or none."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from hydroviews.captures.sfm.features import Features
from hydroviews.captures.sfm.learned.stationary import Matches
from hydroviews.captures.sfm.pairs import Pair

AGREED = 0.5  # share of the cycles of a pair that have to close
# Closed cycles of a pair for each of its matches. In bonsai's drops, half of the wrong pairs have fewer, and two in a
# hundred of the right ones.
CONFIRMED = 0.12


def unconfirmed(views: Sequence[Features], matches: Matches, error: float) -> set[Pair]:
    """Pairs of whose matches too few return by way of a third view; those without a third view are left alone.

    The third view joins the two, so that nothing falls apart without the pair.

    Args:
        views: the features of each.
        matches: verified ones, for every pair.
        error: pixels by which both ways may end apart.
    """
    partners = partner_tables(views, matches)
    found = set()
    for pair, own in matches.items():
        closed, cycles = closed_cycles(views, partners, pair, error)
        if third_views(partners, pair, len(views)) and closed < max(AGREED * cycles, CONFIRMED * len(own)):
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
    for third in third_views(partners, pair, len(views)):
        between = partners[first, third]
        around = np.where(between >= 0, partners[third, second][between], -1)
        both = (around >= 0) & (direct >= 0)
        places = views[second].keypoints[:, :2]
        apart = np.linalg.norm(places[around[both]] - places[direct[both]], axis=1)
        closed, cycles = closed + int((apart <= error).sum()), cycles + int(both.sum())
    return closed, cycles


def third_views(partners: Mapping[Pair, NDArray[np.int64]], pair: Pair, count: int) -> list[int]:
    """The views, of so many, that are paired with both views of a pair."""
    first, second = pair
    return [third for third in range(count) if (first, third) in partners and (third, second) in partners]
