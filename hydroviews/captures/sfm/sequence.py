"""Pairs of views that contradict the order in time: things that look alike, and drops, are matched far apart as well.

Names of photographs are in the order of time. Neighbours in time overlap, so their matches are mostly right and give
the turn of the camera from view to view. Matches of views that are farther apart are wrong more often than right in
rain: 88 of 125 verified pairs of courtyard's medium drops. So the filter chains neighbours whose turn other neighbours
confirm. Pairs between two chains vote for how to join them. A pair that contradicts its chain is left out before
mapping, because mapping never removes such a pair.
"""

import logging
from collections.abc import Mapping, Sequence
from itertools import combinations
from pathlib import Path

import numpy as np
import pycolmap
from numpy.typing import ArrayLike, NDArray

from hydroviews.captures.sfm.features import image_id
from hydroviews.captures.sfm.pairs import Pair
from hydroviews.scene.camera_errors import angles

logger = logging.getLogger(__name__)

NEAR = 3  # views on either side that are neighbours in time
# Degrees by which a pair may turn the camera otherwise, and more for each view between: focal lengths are not known
# yet, and errors add up. Courtyard's turns add up to 74 degrees too many over 40 views.
APART, DRIFT = 20.0, 2.0

Rotation = NDArray[np.float64]  # [3, 3], second view from first view


def leave_out_contradictions(database: Path, names: Sequence[str]) -> None:
    """Remove the matches of pairs that contradict their neighbours in time from a database.

    Args:
        database: with verified matches.
        names: of all images, in the order of time.
    """
    with pycolmap.Database.open(database) as opened:
        ids = [image_id(opened, name) for name in names]
        found = relative_rotations(opened, ids)
        wrong = contradictions(len(names), found)
        for i, j in wrong:
            opened.delete_two_view_geometry(ids[i], ids[j])
            opened.delete_matches(ids[i], ids[j])
    logger.info("%d of %d pairs contradict their neighbours in time and are left out", len(wrong), len(found))


def relative_rotations(database: pycolmap.Database, ids: Sequence[int]) -> dict[Pair, tuple[Rotation, int]]:
    """How the camera turned between the views of each verified pair, and the number of its matches."""
    keypoints = [np.asarray(database.read_keypoints(one), np.float64)[:, :2] for one in ids]
    cameras = {camera.camera_id: camera for camera in database.read_all_cameras()}
    own = [cameras[database.read_image(one).camera_id] for one in ids]
    found = {}
    for i, j in combinations(range(len(ids)), 2):
        if not database.exists_two_view_geometry(ids[i], ids[j]):
            continue
        pair = database.read_two_view_geometry(ids[i], ids[j])
        known = pycolmap.estimate_two_view_geometry_pose(own[i], keypoints[i], own[j], keypoints[j], pair)
        if known and pair.cam2_from_cam1 is not None:
            found[i, j] = pair.cam2_from_cam1.rotation.matrix(), len(pair.inlier_matches)
    return found


def contradictions(count: int, pairs: Mapping[Pair, tuple[Rotation, int]]) -> list[Pair]:
    """The pairs that turn the camera otherwise than the chain of neighbours does.

    Args:
        count: of the views.
        pairs: rotations and numbers of matches; indices are in the order of time.
    """
    near = {pair: found for pair, found in pairs.items() if pair[1] - pair[0] <= NEAR}
    turned, group = orientations(count, confirmed(near))
    turned, group = joined(turned, group, {pair: rotation for pair, (rotation, _) in pairs.items()})
    return [
        (i, j)
        for (i, j), (rotation, _) in pairs.items()
        if group[i] == group[j] and angles(rotation @ turned[i] @ turned[j].T) > _limit(j - i)
    ]


def confirmed(pairs: Mapping[Pair, tuple[Rotation, int]]) -> dict[Pair, tuple[Rotation, int]]:
    """The pairs whose turn at least half of the ways over a third view confirm.

    A chain is as good as its worst link: where the order in time jumps, neighbours are wrong as well, and the views
    after the jump would contradict all before.
    """
    turns = {pair: rotation for pair, (rotation, _) in pairs.items()}
    turns |= {(j, i): rotation.T for (i, j), rotation in turns.items()}
    around: dict[int, set[int]] = {}
    for i, j in turns:
        around.setdefault(i, set()).add(j)

    def closes(i: int, j: int) -> bool:
        over = [bool(angles(turns[k, j] @ turns[i, k] @ turns[j, i]) <= APART) for k in around[i] & around[j]]
        return bool(over) and 2 * sum(over) >= len(over)

    return {pair: found for pair, found in pairs.items() if closes(*pair)}


def orientations(
    count: int, pairs: Mapping[Pair, tuple[Rotation, int]]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Rotations [N, 3, 3] from the first view of each group that pairs connect, and the groups [N].

    Views are connected by the pairs with most matches (a spanning tree).
    """
    from scipy.sparse import coo_array  # takes half a second, and few commands estimate cameras
    from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree

    rows, columns = np.array(list(pairs), np.int64).reshape(-1, 2).T
    matches = np.array([number for _, number in pairs.values()], np.float64)
    tree = minimum_spanning_tree(coo_array((-matches, (rows, columns)), shape=(count, count)).tocsr())
    turned, group = np.tile(np.eye(3), (count, 1, 1)), np.full(count, -1)
    for root in range(count):
        if group[root] >= 0:
            continue
        order, before = breadth_first_order(tree, root, directed=False)
        group[order] = root
        for view in order[1:]:
            last = before[view]
            step = pairs[last, view][0] if last < view else pairs[view, last][0].T
            turned[view] = step @ turned[last]
    return turned, group


def joined(
    turned: NDArray[np.float64], group: NDArray[np.int64], pairs: Mapping[Pair, Rotation]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Rotations [N, 3, 3] and groups [N] of views once groups are joined, the surest first.

    The pairs between two groups vote for how one is turned from the other. Groups of which no two pairs agree stay
    apart.
    """
    turned, group = turned.copy(), group.copy()
    while True:
        links: dict[Pair, list[tuple[Rotation, int]]] = {}
        for (i, j), rotation in pairs.items():
            if group[i] != group[j]:
                across = turned[j].T @ rotation @ turned[i]  # from j's group to i's
                both, across = ((i, j), across) if group[i] < group[j] else ((j, i), across.T)
                links.setdefault((group[both[0]], group[both[1]]), []).append((across, j - i))
        votes = {both: _vote(found) for both, found in links.items()}
        best = max(votes, key=lambda both: votes[both][0], default=None)
        if best is None or not votes[best][0]:
            return turned, group
        moved = group == best[1]
        turned[moved], group[moved] = turned[moved] @ votes[best][1], best[0]


def _vote(links: Sequence[tuple[Rotation, int]]) -> tuple[float, Rotation]:
    """The sum of the votes for the rotation that has most, or 0 if no two agree, and that rotation.

    Pairs that are near in time are right more often: a vote counts one over the views from one to the other.
    """
    rotations, steps = np.array([rotation for rotation, _ in links]), np.array([step for _, step in links])
    alike = angles(rotations[:, None] @ rotations.transpose(0, 2, 1)) <= _limit(steps)
    votes = np.where(alike.sum(1) > 1, (alike / steps).sum(1), 0)
    return float(votes.max()), rotations[votes.argmax()]


def _limit(steps: ArrayLike) -> NDArray[np.float64]:
    """Degrees by which pairs of views that are so far apart may turn the camera otherwise."""
    return APART + DRIFT * np.asarray(steps)
