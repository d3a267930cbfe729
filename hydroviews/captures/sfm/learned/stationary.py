"""Matches that stay in one place of the picture while the scene moves: drops and dirt on the lens."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from hydroviews.captures.sfm.features import Features
from hydroviews.captures.sfm.pairs import Pair

Matches = Mapping[Pair, NDArray[np.int64]]  # indices [M, 2] of features of both views

MOVED = 0.25  # share of a pair's matches that moved for certain, from which its scene moved
DEVIATIONS = 3.0  # by which matches in place outnumber what is expected of a scene


def without_stationary(views: Sequence[Features], matches: Matches, radius: float) -> dict[Pair, NDArray[np.int64]]:
    """Leave out matches on the lens, pair by pair, but not those of a scene that hardly moved.

    The matches of a scene are spread about as densely within `radius` as around it; what is on the lens is a peak
    within. Where the scene moved, all of such a peak is left out. Where next to all matches stay in place, the camera
    may have stood still, on a tripod or in a slow film, or nothing but drops was matched: only features that were on
    the lens in other pairs are left out there.

    Args:
        views: the features of each.
        matches: indices into them, for every pair.
        radius: pixels by which places on the lens may differ.
    """
    lengths = {pair: displacements(views, pair, found) for pair, found in matches.items()}
    on_lens = [np.zeros(len(view), bool) for view in views]
    for pair, found in matches.items():
        if has_peak(lengths[pair], radius):
            for view, features in zip(pair, found[lengths[pair] <= radius].T, strict=True):
                on_lens[view][features] = True
    return {
        (i, j): found[~((lengths[i, j] <= radius) & (on_lens[i][found[:, 0]] | on_lens[j][found[:, 1]]))]
        for (i, j), found in matches.items()
    }


def has_peak(lengths: NDArray[np.float64], radius: float) -> bool:
    """Whether a scene moved and some of its matches did not, by displacements [M] in pixels."""
    inside, around = int((lengths <= radius).sum()), int(((lengths > radius) & (lengths <= 2 * radius)).sum())
    # A quarter of the area within twice the radius is within the radius.
    expected = (inside + around) / 4
    peak = inside > expected + DEVIATIONS * np.sqrt(expected * 3 / 4)
    return bool(peak and len(lengths) - inside - around >= MOVED * len(lengths))


def displacements(views: Sequence[Features], pair: Pair, found: NDArray[np.int64]) -> NDArray[np.float64]:
    """Pixels [M] between the two places of each match."""
    first, second = (views[view].keypoints[found[:, side], :2] for side, view in enumerate(pair))
    return np.asarray(np.linalg.norm(first - second, axis=1), np.float64)
