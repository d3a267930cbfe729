"""How far estimated cameras are from the true ones of the same views.

Poses are world-to-camera, [N, 4, 4], rigid.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hydroviews.errors import InputError
from hydroviews.scene.alignment import ONE_PLACE, Array, Similarity, align, centres

LIMITS = (5.0, 10.0, 30.0)  # degrees


@dataclass(frozen=True)
class CameraErrors:
    """Of estimated cameras; what has no number, as too few are registered, is None."""

    photographs: int
    registered: int
    pose_auc_5: float  # areas under the curve of `pair_errors` up to 5, 10 and 30 degrees, in [0, 1]
    pose_auc_10: float
    pose_auc_30: float
    rotation_error: float | None = None  # median, degrees, once aligned
    position_error: float | None = None  # median, in shares of the cameras' extent, once aligned
    unaligned: str = ""  # why there is no alignment


def compare_cameras(found: Mapping[str, Array], true: Mapping[str, Array]) -> tuple[CameraErrors, Similarity | None]:
    """Errors of the cameras that were found, and the similarity from their world to the true one, if there is one.

    Args:
        found: poses [4, 4] by view.
        true: those of all photographs, found or not.

    Raises:
        InputError: cameras of views that are not in the scene.
    """
    unknown = sorted(set(found) - set(true))
    if unknown:
        raise InputError("cameras of views that are not in the scene", found=", ".join(unknown[:5]))
    names = sorted(found)
    poses, target = (np.array([world[name] for name in names]).reshape(-1, 4, 4) for world in (found, true))
    pairs = len(true) * (len(true) - 1) // 2
    auc_5, auc_10, auc_30 = area_under_curve(pair_errors(poses, target), pairs, LIMITS)
    errors = CameraErrors(len(true), len(names), auc_5, auc_10, auc_30)
    try:
        to_true = align(poses, target)
    except InputError as error:
        return replace(errors, unaligned=str(error)), None
    aligned = to_true.poses(poses)
    rotation, position = (float(np.median(one(aligned, target))) for one in (rotation_errors, position_errors))
    return replace(errors, rotation_error=rotation, position_error=position), to_true


def angles(rotations: Array) -> Array:
    """Angles of rotations [..., 3, 3], degrees in [0, 180]."""
    # From sine and cosine, as the cosine alone knows no angle below 1e-6 degrees.
    sine = np.linalg.norm(rotations - np.swapaxes(rotations, -1, -2), axis=(-2, -1)) / np.sqrt(2)
    return np.degrees(np.arctan2(sine, np.trace(rotations, axis1=-2, axis2=-1) - 1))


def rotation_errors(poses: Array, target: Array) -> Array:
    """Degrees between the directions that cameras of the same world are turned to, [N]."""
    return angles(np.einsum("nij,nkj->nik", poses[:, :3, :3], target[:, :3, :3]))


def position_errors(poses: Array, target: Array) -> Array:
    """Distances between cameras of the same world, in shares of the target's extent, [N].

    The extent is the root mean square distance of the target's cameras from their mean.
    """
    wanted = centres(target)
    extent = np.sqrt(((wanted - wanted.mean(0)) ** 2).sum(1).mean())
    return np.asarray(np.linalg.norm(centres(poses) - wanted, axis=1) / extent)


def pair_errors(poses: Array, target: Array) -> Array:
    """The worse of the two angles, of rotation and of translation, by which relative poses of pairs differ.

    That is the usual measure of relative pose (Jin et al. 2021, Image matching across wide baselines); it needs no
    alignment.

    Returns:
        Degrees in [0, 180] of every pair once, [N (N - 1) / 2]. A pair that has no direction of translation in the
        target, as both cameras are in one place, has only the angle of rotation.
    """
    one, other = np.triu_indices(len(poses), 1)
    turns, ways = zip(*(_relative(world, one, other) for world in (poses, target)), strict=True)
    turned = angles(np.einsum("nij,nkj->nik", *turns))
    lengths = [np.linalg.norm(way, axis=1) for way in ways]
    across = np.linalg.norm(np.cross(*ways), axis=1)
    moved = np.degrees(np.arctan2(across, np.einsum("ni,ni->n", *ways)))
    still = lengths[1] <= ONE_PLACE * np.abs(target[:, :3, 3]).max(initial=1.0)
    moved = np.where(lengths[0] == 0, 180.0, moved)  # no direction where there is one
    return np.maximum(turned, np.where(still, 0.0, moved))


def _relative(poses: Array, one: NDArray[np.intp], other: NDArray[np.intp]) -> tuple[Array, Array]:
    """Rotation [P, 3, 3] and translation [P, 3] from the first cameras of pairs to the second."""
    turn = np.einsum("nij,nkj->nik", poses[other, :3, :3], poses[one, :3, :3])
    return turn, poses[other, :3, 3] - np.einsum("nij,nj->ni", turn, poses[one, :3, 3])


def area_under_curve(errors: Array, total: int, limits: Sequence[float]) -> list[float]:
    """Areas under the share of errors below a threshold, from 0 to each limit, over the limit: in [0, 1].

    Exact for the step function that the share is: the mean of `max(0, 1 - error / limit)`.

    Args:
        errors: of what was found, [K].
        total: with what was not, which counts as wrong.
        limits: in the errors' unit.

    Raises:
        ValueError: more errors than there are in all, or none in all.
    """
    if len(errors) > total or not total:
        raise ValueError(f"{len(errors)} errors of {total}")
    return [float(np.clip(1 - errors / limit, 0, None).sum() / total) for limit in limits]
