"""What the scene looks like without a reference: every Gaussian with the mean of its dynamic features."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from tqdm import tqdm

from baselines.gs_w.appearance import ReferenceAppearance
from baselines.gs_w.fusion import Fusion
from baselines.splatting.appearance import in_sight, moved
from baselines.splatting.gaussians import Gaussians
from baselines.splatting.pruning import contributions
from baselines.splatting.rasterizer import Workspace
from hydroviews.cameras import Camera

UNSEEN = 1e-6  # pixels that a Gaussian counts for where it is in sight but hidden


class Weighing:
    """Means over views in which a Gaussian counts for as much as it is of the picture, in pixels.

    A picture shows nothing of a Gaussian that is hidden in it, and what the projection map has there is of others.
    """

    def __init__(self, gaussians: Gaussians, near: float, antialiased: bool) -> None:
        self._gaussians, self._near, self._antialiased = gaussians, near, antialiased
        self._workspace = Workspace()
        self._sum: NDArray[np.float64] | None = None
        self._total = np.zeros(len(gaussians))

    def add(self, camera: Camera, rows: Tensor, values: Tensor) -> None:
        """Values [n, F] that the Gaussians in these rows [n] have in a view."""
        which = rows.cpu().numpy()
        shown = contributions(self._gaussians, [camera], self._near, self._antialiased, self._workspace)
        weights = np.maximum(shown[which], UNSEEN)
        if self._sum is None:
            self._sum = np.zeros((len(self._total), values.shape[1]))
        self._sum[which] += weights[:, None] * values.cpu().numpy()
        self._total[which] += weights

    def mean(self) -> NDArray[np.float32]:
        """The means [N, F]; those of all together for Gaussians that are in sight nowhere."""
        assert self._sum is not None
        overall = self._sum.sum(axis=0) / max(float(self._total.sum()), UNSEEN)
        means = self._sum / np.maximum(self._total, UNSEEN)[:, None]
        return np.ascontiguousarray(np.where(self._total[:, None] > 0, means, overall), np.float32)


@torch.no_grad()
def averaged(
    gaussians: Gaussians, appearance: ReferenceAppearance, cameras: Sequence[Camera], near: float, antialiased: bool
) -> Gaussians:
    """The same Gaussians, whose features are the means of their dynamic ones [N, D] over the training views.

    Args:
        gaussians: trained, with coordinates as features.
        appearance: trained with them.
        cameras: of the training views, in order.
        near: as trained.
        antialiased: as trained.
    """
    parameters, weighing = tensors(gaussians, appearance.fusion), Weighing(gaussians, near, antialiased)
    for view, camera in enumerate(tqdm(cameras, desc="averaging the views' features", unit="view", leave=False)):
        local = moved(camera, gaussians.origin)
        rows, seen = in_sight(parameters, local)
        weighing.add(camera, rows, appearance.read(appearance.encode(view)[0], seen, local))
    return replace(gaussians, features=weighing.mean())


@torch.no_grad()
def looking(gaussians: Gaussians, fusion: Fusion, camera: Camera) -> Gaussians:
    """What averaged Gaussians look like to a camera, those in sight, ready to be rendered."""
    local = moved(camera, gaussians.origin)
    rows, seen = in_sight(tensors(gaussians, fusion), local)
    sh = fusion.coloured(seen, local, seen["features"])
    return replace(gaussians.bare().select(rows.cpu().numpy()), sh=np.ascontiguousarray(sh.cpu().numpy()))


@torch.no_grad()
def from_everywhere(
    gaussians: Gaussians, fusion: Fusion, cameras: Sequence[Camera], near: float, antialiased: bool
) -> NDArray[np.float32]:
    """Coefficients [N, 3] of degree 0 for viewers: means of what averaged Gaussians show to the training cameras."""
    parameters, weighing = tensors(gaussians, fusion), Weighing(gaussians, near, antialiased)
    for camera in tqdm(cameras, desc="averaging the views' colours", unit="view", leave=False):
        local = moved(camera, gaussians.origin)
        rows, seen = in_sight(parameters, local)
        weighing.add(camera, rows, fusion.coloured(seen, local, seen["features"])[:, 0])
    return weighing.mean()


def tensors(gaussians: Gaussians, fusion: Fusion) -> dict[str, Tensor]:
    """The parameters, where the network is."""
    device = fusion.middle.device
    return {name: torch.from_numpy(value).to(device) for name, value in gaussians.arrays().items()}
