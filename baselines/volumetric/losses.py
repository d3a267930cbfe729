"""The losses of a plain field; a method's is a function like `photometric_losses`, with losses of its own."""

from collections.abc import Callable

from torch import Tensor

from baselines.volumetric.config import VolumetricConfig
from baselines.volumetric.model import Rendering
from baselines.volumetric.rays.batches import Batch
from baselines.volumetric.rays.sampling import distortion_loss, interlevel_loss

INTERLEVEL = 1.0  # weight of the loss of the proposal network (Mip-NeRF 360, equation 13)

Losses = dict[str, Tensor]
Loss = Callable[[Rendering, Batch], Losses]  # named losses, which are added up


def squared_error(colour: Tensor, batch: Batch) -> Tensor:
    """Squared differences [R], averaged over channels and weighted pixel by pixel."""
    return batch.weights * (colour - batch.colours).square().mean(1)


def proposal_losses(rendering: Rendering, batch: Batch, config: VolumetricConfig, coarse: float = 1.0) -> Losses:
    """Losses of the proposal network, or of a coarse field its own squared error, and against scattered density.

    The coarse field's has the weight `coarse`.
    """
    losses = {}
    if rendering.coarse_colour is not None:
        losses["coarse"] = coarse * squared_error(rendering.coarse_colour, batch).mean()
    elif rendering.proposal_weights.requires_grad:
        histogram = rendering.proposal_edges, rendering.proposal_weights
        bounds = interlevel_loss(rendering.samples.edges, rendering.weights, *histogram)
        losses["interlevel"] = INTERLEVEL * bounds.mean()
    if config.distortion:
        scattered = distortion_loss(rendering.samples.edges, rendering.weights)
        losses["distortion"] = config.distortion * scattered.mean()
    return losses


def photometric_losses(config: VolumetricConfig) -> Loss:
    """The loss of a plain field: the mean squared error of the pixels that count, and `proposal_losses`."""

    def loss(rendering: Rendering, batch: Batch) -> Losses:
        return {"colour": squared_error(rendering.colour, batch).mean(), **proposal_losses(rendering, batch, config)}

    return loss
