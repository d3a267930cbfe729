"""What the scene looks like in no photograph: every Gaussian toned as in the mean of those that show it."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from baselines.splatting.appearance.view_averages import mean_over_views
from baselines.splatting.gaussians import Gaussians
from baselines.wild_gaussians.appearance import WildAppearance, toned
from hydroviews.scene.cameras import Camera


def mean_appearance(
    gaussians: Gaussians, appearance: WildAppearance, cameras: Sequence[Camera], near: float, antialiased: bool
) -> Gaussians:
    """Ordinary Gaussians in colours that no longer depend on the view.

    The authors tone all with the mean embedding. What is seen in a stretch of views alone has its colours for their
    embeddings, which may be far from that.

    Args:
        gaussians: trained, plain.
        appearance: trained with them.
        cameras: of the training views, in order.
        near: as trained.
        antialiased: as trained.
    """

    def change(view: int, _: Camera, seen: dict[str, Tensor]) -> Tensor:
        return torch.cat(appearance.change(seen["sh"][:, 0], seen["features"], appearance.views[view]), dim=1)

    changes = mean_over_views(gaussians, cameras, change, near, antialiased, appearance.views.device, "tones")
    gains, offsets = torch.from_numpy(changes).split(3, dim=1)
    sh = toned(torch.from_numpy(gaussians.sh), gains, offsets)
    return replace(gaussians.bare(), sh=np.ascontiguousarray(sh.numpy()))
