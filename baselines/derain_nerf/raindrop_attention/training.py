"""The training of a generator that finds and removes drops, against a discriminator (Qian et al. 2018)."""

from typing import Any

import torch
from torch import Tensor, nn

from baselines.derain_nerf.raindrop_attention.config import TrainingConfig
from baselines.derain_nerf.raindrop_attention.discriminator import Discriminator
from baselines.derain_nerf.raindrop_attention.losses import attention_loss, discriminator_loss, generator_losses
from baselines.derain_nerf.raindrop_attention.network import DerainGenerator
from baselines.derain_nerf.raindrop_attention.pairs import Batch
from baselines.supervised.training import Learner, SupervisedTraining

GENERATOR, DISCRIMINATOR = "generator", "discriminator"
BETAS = {GENERATOR: (0.9, 0.999), DISCRIMINATOR: (0.5, 0.999)}  # of Adam


class AttentionTraining(SupervisedTraining):
    """Both networks, the generator's averaged weights, the optimisers and how far they are."""

    config: TrainingConfig
    averaged: DerainGenerator

    def __init__(self, config: TrainingConfig) -> None:
        torch.manual_seed(config.seed)
        self.generator = _fast(DerainGenerator(config.generator))
        self.discriminator = _fast(Discriminator(config.discriminator))
        networks = {GENERATOR: self.generator, DISCRIMINATOR: self.discriminator}
        learners = {
            name: Learner(network, torch.optim.Adam(network.parameters(), config.rate, BETAS[name]))
            for name, network in networks.items()
        }
        super().__init__(config, learners)

    def _learn(self, batch: Batch) -> dict[str, Tensor]:
        """One step of the generator; where removal learns, one of the discriminator as well."""
        batch = Batch(*(plane.contiguous(memory_format=torch.channels_last) for plane in batch))
        removing = self.iteration % self.config.removal_every == 0
        return self._learn_all(batch) if removing else self._learn_attention(batch)

    def _learn_attention(self, batch: Batch) -> dict[str, Tensor]:
        with self._autocast():
            maps = self.generator.maps(batch.rainy)
        loss = attention_loss(maps, batch.cover)
        self._descend(GENERATOR, loss)
        return {"attention": loss}

    def _learn_all(self, batch: Batch) -> dict[str, Tensor]:
        self.discriminator.requires_grad_(False)
        with self._autocast():
            found = self.generator(batch.rainy)
            judged = self.discriminator(found.frames.whole)
        losses = generator_losses(found, batch.clean, batch.cover, judged, self.config.losses)
        self._descend(GENERATOR, losses.total(self.config.losses))
        self.discriminator.requires_grad_(True)
        judgement = self._learn_discriminator(found.frames.whole.detach(), batch.clean, found.maps[-1].detach())
        return {**losses._asdict(), DISCRIMINATOR: judgement}

    def _learn_discriminator(self, derained: Tensor, clean: Tensor, attention: Tensor) -> Tensor:
        with self._autocast():
            judged, real = self.discriminator(derained), self.discriminator(clean)
        loss = discriminator_loss(judged, real, attention)
        self._descend(DISCRIMINATOR, loss)
        return loss


def _fast(network: nn.Module) -> Any:
    """Channels last: what convolutions on processors are quickest with."""
    return network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
