"""Gaussians for viewers: what the 2D filter of Mip-Splatting does to them, folded into their opacities.

A renderer widens every splat by LOW_PASS. With the filter (Yu et al. 2024) a splat becomes as much fainter as it is
wider, by the square root of the determinants' ratio; viewers do not know of it. The ratio depends on how large a splat
is on the picture: its mean over the training views is taken, so that a viewer shows the same from about there. Shapes
stay as they are, since both renderers widen alike.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from baselines.splatting.gaussians import Gaussians
from baselines.splatting.kernels.constants import LOW_PASS
from hydroviews.scene.cameras import Camera
from hydroviews.scene.quaternions import rotation_matrices

FAINTEST = 1e-30  # factor: logits stay finite


def without_filter(gaussians: Gaussians, cameras: Sequence[Camera], near: float) -> Gaussians:
    """The Gaussians that a renderer without the 2D filter shows as one with the filter shows the given ones.

    Args:
        gaussians: trained with the filter.
        cameras: in whose views it should be so; with one, it is exactly so.
        near: nearest depth shown, in world units.

    Returns:
        The same with other opacities. Those that no camera has in its picture are as they were.
    """
    total, views = np.zeros(len(gaussians)), np.zeros(len(gaussians))
    axes = rotation_matrices(gaussians.quaternions) * np.exp(gaussians.log_scales.astype(np.float64))[:, None]
    for camera in cameras:
        seen, factors = _factors(gaussians, axes, camera, near)
        total[seen] += factors
        views[seen] += 1
    factor = np.where(views > 0, total / np.maximum(views, 1), 1.0)
    logits = gaussians.opacity_logits.astype(np.float64)
    return replace(gaussians, opacity_logits=_fainter(logits, factor).astype(np.float32))


def _factors(
    gaussians: Gaussians, axes: NDArray[np.float64], camera: Camera, near: float
) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Which Gaussians have their middle in a picture, and by how much the filter makes each of them fainter.

    Args:
        gaussians: N of them.
        axes: their scaled axes, the columns of [N, 3, 3].
        camera: takes the picture.
        near: nearest depth shown.
    """
    offset = gaussians.origin - camera.centre
    local = (gaussians.means + offset) @ camera.rotation.T
    depth = np.where(local[:, 2] > near, local[:, 2], np.inf)
    slopes = local[:, :2] / depth[:, None]
    pixels = slopes * (camera.fx, camera.fy) + (camera.cx, camera.cy)
    inside = ((pixels >= 0) & (pixels <= (camera.width, camera.height))).all(axis=1) & np.isfinite(depth)
    seen = np.flatnonzero(inside)
    turned = camera.rotation @ axes[seen]  # axes in camera coordinates
    x, y, z = turned[:, 0], turned[:, 1], turned[:, 2]
    a = camera.fx / depth[seen, None] * (x - slopes[seen, :1] * z)
    b = camera.fy / depth[seen, None] * (y - slopes[seen, 1:] * z)
    sharp = (np.cross(a, b) ** 2).sum(axis=1)  # the determinant, without cancellation for needles
    wide = sharp + LOW_PASS * ((a * a).sum(axis=1) + (b * b).sum(axis=1)) + LOW_PASS**2
    return seen, np.sqrt(sharp / wide)


def _fainter(logits: NDArray[np.float64], factor: NDArray[np.float64]) -> NDArray[np.float64]:
    """The logit of factor x sigmoid(logit): log(f) - log(1 - f + e^-logit)."""
    factor = np.clip(factor, FAINTEST, 1)
    return np.log(factor) - np.log(1 - factor + np.exp(-np.clip(logits, -80, 80)))
