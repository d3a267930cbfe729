"""CR-NeRF's loss: that of masked pixels, and what styles cost."""

from baselines.cr_nerf.config import CrNerfConfig
from baselines.masking.rays import masked_losses
from baselines.volumetric.losses import Loss, Losses
from baselines.volumetric.model import Rendering
from baselines.volumetric.rays.batches import Batch

STYLE_PENALTY = 1e-5  # weight of the mean square of the style maps (CR-NeRF's authors)


def cr_nerf_losses(config: CrNerfConfig) -> Loss:
    """`masked_losses`, and the mean square of the style maps."""

    def loss(rendering: Rendering, batch: Batch) -> Losses:
        penalty = STYLE_PENALTY * rendering.extras["maps"].square().mean()
        return masked_losses(rendering, batch, config.volumetric, {"style": penalty})

    return loss
