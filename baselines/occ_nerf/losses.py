"""The losses: of the field of everything and the detector first, then of the background as well.

    first     mean (C - I)^2 + 0.03 corr
    then      mean (C - I)^2 + 0.01 corr + 2 mean((C_b - I)^2 [m < .5]) + mean(|d_b - stop(d)| [m < .5])

C, d and m are colour, depth and detector of everything, C_b and d_b of the background, I is the photograph; with the
losses of the proposals, for either field. Where there is a foreground the background learns nothing: other views,
which see past it, have to tell what is there.
"""

import logging
from dataclasses import replace

from torch import Tensor

from baselines.occ_nerf.config import OccNerfConfig
from baselines.occ_nerf.detector import correlation_loss
from baselines.volumetric.losses import Loss, Losses, proposal_losses, squared_error
from baselines.volumetric.model import Rendering
from baselines.volumetric.rays.batches import Batch

logger = logging.getLogger(__name__)

FEWEST = 0.05  # of a step's rays; if fewer are background, the detector is not followed


class WarnOnce:
    """Logs its first warning and no other."""

    def __init__(self) -> None:
        self._warned = False

    def __call__(self, message: str, *values: float) -> None:
        """Log, with values for the message's %, unless it has been done."""
        if not self._warned:
            logger.warning(message, *values)
        self._warned = True


def occ_nerf_losses(config: OccNerfConfig) -> Loss:
    """The losses of a step; those of the background where the rendering has one."""
    warn = WarnOnce()

    def loss(rendering: Rendering, batch: Batch) -> Losses:
        alone = "background_colour" not in rendering.extras
        m, gap = rendering.extras["foreground"], rendering.extras["gap"]
        weight = config.early_correlation if alone else config.late_correlation
        losses = {
            "colour": squared_error(rendering.colour, batch).mean(),
            "detector": weight * correlation_loss(m, gap, config.gap, batch.weights),
            **proposal_losses(rendering, batch, config.volumetric),
        }
        return losses if alone else losses | background_losses(rendering, batch, config, warn)

    return loss


def background_losses(rendering: Rendering, batch: Batch, config: OccNerfConfig, warn: WarnOnce) -> Losses:
    """Those of the background; warns where the detector leaves it next to nothing."""
    extras = rendering.extras
    learned = _learned(extras["foreground"], batch.weights, warn)
    error = (extras["background_colour"] - batch.colours).square().mean(1)
    apart = (extras["background_depth"] - extras["depth"].detach()).abs()
    losses = {
        "background": config.background_weight * (learned * error).mean(),
        "depth": config.depth_weight * (learned * apart).mean(),
    }
    if rendering.coarse_colour is None:
        seen = replace(rendering, weights=extras["background_weights"])
        proposal = proposal_losses(seen, batch, config.volumetric)
        losses |= {f"background {name}": value for name, value in proposal.items()}
    return losses


def _learned(m: Tensor, counts: Tensor, warn: WarnOnce) -> Tensor:
    """How much each ray [R] counts for the background; all as they are, if next to all are taken for foreground."""
    kept = counts * (m.detach() < 0.5)
    if kept.sum() >= FEWEST * counts.sum():
        return kept
    warn(
        "training: the detector takes %.1f %% of the rays for foreground, which leaves the background next to "
        "nothing to learn from; in such steps all rays count, as if there were no foreground",
        100 * float(1 - kept.sum() / counts.sum()),
    )
    return counts
