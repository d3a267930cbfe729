"""CR-NeRF's loss: that of masked pixels, and what styles cost."""

from baselines.cr_nerf.config import CrNerfConfig
from baselines.masking.rays import masked_losses
from baselines.volumetric.losses import Loss, Losses
from baselines.volumetric.model import Rendering
from baselines.volumetric.rays.batches import Batch


def cr_nerf_losses(config: CrNerfConfig) -> Loss:
    """`masked_losses`, and the mean square of the style maps."""

    def loss(rendering: Rendering, batch: Batch) -> Losses:
        penalty = config.style.penalty * rendering.extras["maps"].square().mean()
        return masked_losses(rendering, batch, config.volumetric, {"style": penalty})

    return loss
