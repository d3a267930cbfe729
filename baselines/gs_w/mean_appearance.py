"""What the scene looks like without a reference: every Gaussian with the mean of its dynamic features."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from baselines.gs_w.appearance import ReferenceAppearance
from baselines.gs_w.fusion import Fusion
from baselines.splatting.appearance.gaussians import in_sight, moved, tensors
from baselines.splatting.appearance.view_averages import mean_over_views
from baselines.splatting.gaussians import Gaussians
from baselines.training.torch_state import one_thread
from hydroviews.scene.cameras import Camera


def average_features(
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

    def dynamic(view: int, camera: Camera, seen: dict[str, Tensor]) -> Tensor:
        return appearance.read(appearance.encode(view)[0], seen, camera)

    features = mean_over_views(gaussians, cameras, dynamic, near, antialiased, appearance.device, "features")
    return replace(gaussians, features=features)


@one_thread()
@torch.no_grad()
def coloured_for(gaussians: Gaussians, fusion: Fusion, camera: Camera) -> Gaussians:
    """Gaussians with average features in the colours they show to a camera, those in sight, ready to be rendered."""
    local = moved(camera, gaussians.origin)
    rows, seen = in_sight(tensors(gaussians, fusion.middle.device), local)
    sh = fusion.coloured(seen, local, seen["features"])
    return replace(gaussians.bare().select(rows.cpu().numpy()), sh=np.ascontiguousarray(sh.cpu().numpy()))


def mean_colours(
    gaussians: Gaussians, fusion: Fusion, cameras: Sequence[Camera], near: float, antialiased: bool
) -> NDArray[np.float32]:
    """Coefficients [N, 3] of degree 0 for viewers: means of what the training cameras are shown of average features."""

    def first(_: int, camera: Camera, seen: dict[str, Tensor]) -> Tensor:
        return fusion.coloured(seen, camera, seen["features"])[:, 0]

    return mean_over_views(gaussians, cameras, first, near, antialiased, fusion.middle.device, "colours")
