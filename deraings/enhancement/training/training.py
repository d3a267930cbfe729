"""The training of an enhancement network: how a batch is learned from. The rest is `baselines.supervised`."""

from typing import ClassVar

import torch
from torch import Tensor

from baselines.supervised.training import Learner, SupervisedTraining
from deraings.enhancement.architecture.mist_branch import crop_mist, mist_loss, without_mist
from deraings.enhancement.architecture.network import EnhancementNetwork
from deraings.enhancement.training.config import TrainingConfig
from deraings.enhancement.training.loss import cover_loss, enhancement_loss, error_loss
from deraings.enhancement.training.pairs import Sample

NETWORK = "network"  # the learner's name
WEIGHT_DECAY = 1e-4  # of AdamW (Loshchilov and Hutter 2019)


class EnhancementTraining(SupervisedTraining):
    """A network, its averaged weights, its optimiser and how far they are."""

    clip: ClassVar[float] = 2.0

    config: TrainingConfig
    averaged: EnhancementNetwork

    def __init__(self, config: TrainingConfig, device: str = "cpu", start: EnhancementNetwork | None = None) -> None:
        """Begin with random weights, the same ones on every device, or with those of a trained network.

        A network to start from has the same configuration, or lacks the part that looks at lenses or the one that
        predicts cover or error: such a part begins with random weights.
        """
        torch.manual_seed(config.seed)
        self.network = EnhancementNetwork(config.network).to(device)
        if start is not None:
            self.network.load_state_dict(start.state_dict(), strict=config.network == start.config)
            if config.network.lens_mist and not start.config.lens_mist:
                self.network.lens_mist.load_state_dict(start.mist.state_dict(), strict=False)
        optimiser = torch.optim.AdamW(self.network.parameters(), config.rate, weight_decay=WEIGHT_DECAY, fused=True)
        super().__init__(config, {NETWORK: Learner(self.network, optimiser)})

    def _learn(self, batch: Sample) -> dict[str, Tensor]:
        loss = self._loss(batch)
        self._descend(NETWORK, loss)
        return {"loss": loss}

    def _loss(self, batch: Sample) -> Tensor:
        config, network, rainy, extra = self.config, self.network, batch.rainy, torch.zeros(())
        if config.network.mist:
            wholes = [whole.flatten(0, 1) for whole in (batch.whole_rainy, batch.whole_clean, batch.whole_mist)]
            mists = network.find_mist(wholes[0], batch.coarse.flatten(0, 1))
            extra = config.lifting * mist_loss(mists, *wholes)
            own = mists.unflatten(0, batch.whole_rainy.shape[:2])[:, 0]
            rainy = without_mist(rainy, crop_mist(own, batch.box, rainy.shape[-2], rainy.shape[-1]))
        with self._autocast():
            first = network.first_cover(rainy, batch.fine)
            features = network.features(rainy, batch.fine, first)
            enhanced = network.enhanced(rainy, features)
            second = None if first is None else network.second_cover(first, features)
            scale = network.error_scale(features.detach())  # the picture is not to be traded for a better known error
        for logits in (first, second):
            if logits is not None:
                extra = extra + config.detection * cover_loss(logits, batch.cover)
        if scale is not None:
            extra = extra + config.doubt * error_loss(scale, enhanced.detach().float(), batch.clean)
        return extra + enhancement_loss(enhanced.float(), batch.clean, batch.rainy, config.frequency)
