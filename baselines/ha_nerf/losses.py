"""Ha-NeRF's loss: what is masked counts less, and masking costs."""

from baselines.ha_nerf.config import HaNerfConfig
from baselines.masking.rays import masked_losses
from baselines.volumetric.losses import Loss, Losses
from baselines.volumetric.model import Rendering
from baselines.volumetric.rays.batches import Batch

LOOK_PENALTY = 1e-5  # weight of the mean square of the looks (Ha-NeRF's authors)


def ha_nerf_losses(config: HaNerfConfig) -> Loss:
    """`masked_losses`, and the mean square of the looks."""

    def loss(rendering: Rendering, batch: Batch) -> Losses:
        penalty = LOOK_PENALTY * rendering.extras["looks"].square().mean()
        return masked_losses(rendering, batch, config.volumetric, {"look": penalty})

    return loss
