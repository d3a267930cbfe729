"""The terms of a plain field's loss; a method's loss is a function like `photometric_terms`, with terms of its own."""

from collections.abc import Callable

from torch import Tensor

from baselines.volumetric.batches import Batch
from baselines.volumetric.config import VolumetricConfig
from baselines.volumetric.model import Rendering
from baselines.volumetric.sampling import distortion_loss, interlevel_loss

Terms = dict[str, Tensor]
Loss = Callable[[Rendering, Batch], Terms]  # named terms that are added up


def squared_error(colour: Tensor, batch: Batch) -> Tensor:
    """Squared differences [R], averaged over channels and weighted pixel by pixel."""
    return batch.weights * (colour - batch.colours).square().mean(1)


def guide_terms(rendering: Rendering, batch: Batch, config: VolumetricConfig) -> Terms:
    """What teaches the guide and keeps density together; of a guide with colours its own squared error."""
    terms = {}
    if rendering.coarse_colour is not None:
        terms["coarse"] = squared_error(rendering.coarse_colour, batch).mean()
    elif rendering.guide_weights.requires_grad:
        histogram = rendering.guide_edges, rendering.guide_weights
        bounds = interlevel_loss(rendering.samples.edges, rendering.weights, *histogram)
        terms["interlevel"] = config.interlevel * bounds.mean()
    if config.distortion:
        scattered = distortion_loss(rendering.samples.edges, rendering.weights)
        terms["distortion"] = config.distortion * scattered.mean()
    return terms


def photometric_terms(config: VolumetricConfig) -> Loss:
    """The loss of a plain field: the mean squared error of the pixels that count, and `guide_terms`."""

    def loss(rendering: Rendering, batch: Batch) -> Terms:
        return {"colour": squared_error(rendering.colour, batch).mean(), **guide_terms(rendering, batch, config)}

    return loss
