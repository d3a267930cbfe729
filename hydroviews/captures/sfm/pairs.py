"""Which pairs of views are matched: indices, the smaller first."""

import numpy as np
from numpy.typing import NDArray

# Matching all pairs grows with the square of the views; above this many a sequence is assumed.
EXHAUSTIVE_LIMIT = 80
OVERLAP = 8  # views before and after, and those 16, 32, 64... away
KEYFRAMES = 40  # evenly spaced views matched with each other, which closes loops
NEIGHBOURS = 12  # views matched with each one where poses are known
MAX_ANGLE = 60.0  # degrees between viewing directions up to which features match

Pair = tuple[int, int]


def all_pairs(count: int) -> set[Pair]:
    """Every view with every other."""
    return {(i, j) for i in range(count) for j in range(i + 1, count)}


def sequence_pairs(count: int) -> set[Pair]:
    """Neighbours in a sequence, views at distances growing as powers of two, and keyframes with each other."""
    steps = [*range(1, OVERLAP + 1)]
    while steps[-1] * 2 < count:
        steps.append(steps[-1] * 2)
    near = {(i, i + step) for step in steps for i in range(count - step)}
    keyframes = np.unique(np.linspace(0, count - 1, min(KEYFRAMES, count)).round().astype(int))
    return near | {(int(a), int(b)) for a in keyframes for b in keyframes if a < b}


def pose_pairs(world_to_camera: NDArray[np.float64]) -> set[Pair]:
    """Each view with up to NEIGHBOURS nearest ones whose viewing directions differ by at most MAX_ANGLE.

    Args:
        world_to_camera: [N, 4, 4].

    Returns:
        Pairs of indices, the smaller first.
    """
    rotations = world_to_camera[:, :3, :3]
    centres = -np.einsum("nji,nj->ni", rotations, world_to_camera[:, :3, 3])
    directions = rotations[:, 2]
    distances = np.linalg.norm(centres[:, None] - centres, axis=-1)
    distances[directions @ directions.T < np.cos(np.radians(MAX_ANGLE))] = np.inf
    np.fill_diagonal(distances, np.inf)
    pairs = set()
    for i, row in enumerate(distances):
        near = np.argsort(row, kind="stable")[:NEIGHBOURS]
        pairs |= {(min(i, int(j)), max(i, int(j))) for j in near if np.isfinite(row[j])}
    return pairs
