"""The similarity between the worlds of two sets of cameras of the same views.

Poses are world-to-camera, [N, 4, 4], rigid.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hydroviews.errors import InputError

Array = NDArray[np.float64]

NEEDED = 3  # cameras that an alignment is found from
ONE_PLACE = 1e-9  # spread of positions over their distance from the origin
MIRRORED = 0.5  # residual with a mirror image over that without, below which the cameras are mirrored
ROUNDS = 20  # of reweighting


@dataclass(frozen=True)
class Similarity:
    """From one world to another: x goes to `scale * rotation @ x + translation`."""

    scale: float
    rotation: Array  # [3, 3], determinant 1
    translation: Array  # [3]

    def points(self, positions: Array) -> Array:
        """Positions [N, 3] in the other world."""
        return self.scale * positions @ self.rotation.T + self.translation

    def poses(self, poses: Array) -> Array:
        """The same cameras in the other world."""
        moved = poses.copy()
        moved[..., :3, :3] = poses[..., :3, :3] @ self.rotation.T
        moved[..., :3, 3] = self.scale * poses[..., :3, 3] - moved[..., :3, :3] @ self.translation
        return moved

    def inverse(self) -> "Similarity":
        """The way back."""
        back = self.rotation.T / self.scale
        return Similarity(1 / self.scale, self.rotation.T, -back @ self.translation)


def centres(poses: Array) -> Array:
    """Positions of cameras [N, 3]."""
    return -np.einsum("nji,nj->ni", poses[:, :3, :3], poses[:, :3, 3])


def align(poses: Array, target: Array) -> Similarity:
    """The similarity that takes cameras to where the same views' cameras are in the target's world.

    The rotation fits positions (Umeyama 1991) and the cameras' axes alike (Wahba 1965, solved by Markley 1988), so that
    cameras on a line have one; scale and translation fit positions. Cameras are reweighted by what is left of their
    distances, so that a few that are wrong count little.

    Raises:
        InputError: fewer than three cameras, all in one place, or mirrored.
    """
    if len(poses) < NEEDED:
        raise InputError(f"{len(poses)} cameras to align", expected=f"at least {NEEDED}")
    source, wanted = centres(poses), centres(target)
    for places in (source, wanted):
        if np.ptp(places, axis=0).max() <= ONE_PLACE * max(1.0, float(np.abs(places).max())):
            raise InputError("all cameras to align are in one place", expected="some that differ, which give the scale")
    axes = np.einsum("nji,njk->ik", target[:, :3, :3], poses[:, :3, :3]) / len(poses)
    weights = np.full(len(poses), 1 / len(poses))
    for _ in range(ROUNDS):
        fit = _fit(source, wanted, weights, axes)
        left = _distances(fit, source, wanted)
        weights = 1 / np.maximum(left, np.median(left) + 1e-12)
        weights /= weights.sum()
    # By positions alone, since those in a plane fit either way, however their axes are turned.
    plain, mirrored = (np.median(_distances(_fit(source, wanted, weights, mirror=m), source, wanted)) for m in (0, 1))
    if mirrored + ONE_PLACE * np.ptp(wanted, axis=0).max() < MIRRORED * plain:
        raise InputError(
            "the cameras to align are the mirror image of the others",
            found=f"median distance {plain:.3g}, mirrored {mirrored:.3g}",
            fix="look for an axis of the wrong sign in the file that they are from",
        )
    return fit


def _distances(fit: Similarity, source: Array, wanted: Array) -> Array:
    return np.asarray(np.linalg.norm(fit.points(source) - wanted, axis=1))


def _fit(source: Array, wanted: Array, weights: Array, axes: Array | float = 0.0, mirror: int = 0) -> Similarity:
    """Weighted least squares, to positions and to the mean turn of axes; with `mirror` the best that is no rotation."""
    mean, wanted_mean = weights @ source, weights @ wanted
    source, wanted = source - mean, wanted - wanted_mean
    spread, wanted_spread = (np.sqrt(weights @ (one**2).sum(1)) for one in (source, wanted))
    moments = np.einsum("n,ni,nj->ij", weights, wanted, source)
    u, _, vt = np.linalg.svd(moments / (spread * wanted_spread) + axes)
    sign = np.linalg.det(u @ vt) * (-1 if mirror else 1)
    rotation = u @ np.diag([1, 1, sign]) @ vt
    scale = max(float(np.trace(rotation.T @ moments)), 0.0) / spread**2
    return Similarity(scale, rotation, wanted_mean - scale * rotation @ mean)
