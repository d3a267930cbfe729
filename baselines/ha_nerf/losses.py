"""Ha-NeRF's loss: what is masked counts less, and masking costs."""

from dataclasses import replace

from baselines.ha_nerf.config import HaNerfConfig
from baselines.volumetric.batches import Batch
from baselines.volumetric.losses import Loss, Losses, proposal_losses, squared_error
from baselines.volumetric.model import Rendering


def ha_nerf_losses(config: HaNerfConfig) -> Loss:
    """The losses of a step.

    colour  0.5 mean((1 - m) |C - C*|^2), and so for a coarse field, whose error teaches m nothing
    size    lambda_s mean(m^2), without which everything would be masked
    look    the mean square of the looks

    and that of the proposal network. Pixels of weight 0 count in none of them.
    """

    def loss(rendering: Rendering, batch: Batch) -> Losses:
        m, counts = rendering.extras["m"], batch.weights
        visible = replace(batch, weights=counts * (1 - m.detach()))
        return {
            "colour": ((1 - m) * squared_error(rendering.colour, batch)).mean() / 2,
            "size": rendering.extras["price"] * (counts * m.square()).mean(),
            "look": config.look.penalty * rendering.extras["looks"].square().mean(),
            **proposal_losses(rendering, visible, config.volumetric, coarse=0.5),
        }

    return loss
