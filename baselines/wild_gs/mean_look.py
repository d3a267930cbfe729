"""What the scene looks like in no photograph: the mean global look, and for every Gaussian its mean local look."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from baselines.splatting.appearance.gaussians import tensors
from baselines.splatting.appearance.view_averages import mean_over_views
from baselines.splatting.gaussians import Gaussians
from baselines.wild_gs.appearance import LookAppearance
from hydroviews.scene.cameras import Camera


@torch.no_grad()
def mean_look(
    gaussians: Gaussians, appearance: LookAppearance, cameras: Sequence[Camera], near: float, antialiased: bool
) -> Gaussians:
    """Ordinary Gaussians in colours that no longer depend on the view.

    Averaged is what comes before the networks of codes: the encoder's features, and what Gaussians read of triplanes,
    each view counting for as many pixels as the Gaussian is of it. Where a view does not show a Gaussian its triplane
    is empty there: a mean of whole triplanes would be of such, too.

    Args:
        gaussians: trained, with intrinsic numbers as features.
        appearance: trained with them.
        cameras: of the training views, in order.
        near: as trained.
        antialiased: as trained.
    """
    wholes = []

    def places(view: int, camera: Camera, seen: dict[str, Tensor]) -> Tensor:
        whole, visible = appearance.encode(view)
        wholes.append(whole)
        return appearance.read(view, visible, seen, camera)

    found = mean_over_views(gaussians, cameras, places, near, antialiased, appearance.device, "looks")
    parameters = tensors(gaussians, appearance.device)
    positions = appearance.colours.in_box(parameters["means"])
    local = torch.from_numpy(found).to(appearance.device)
    codes = appearance.colours.codes(torch.stack(wholes).mean(dim=0), local, positions)
    sh = parameters["sh"] + appearance.colours.added(codes, parameters["features"])
    return replace(gaussians.bare(), sh=np.ascontiguousarray(sh.cpu().numpy()))
