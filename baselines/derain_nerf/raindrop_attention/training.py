"""The training of a generator that finds and removes drops, against a discriminator (Qian et al. 2018)."""

from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from baselines.derain_nerf.raindrop_attention.config import TrainingConfig
from baselines.derain_nerf.raindrop_attention.discriminator import Discriminator
from baselines.derain_nerf.raindrop_attention.losses import attention_loss, discriminator_loss, generator_losses
from baselines.derain_nerf.raindrop_attention.network import DerainGenerator
from baselines.derain_nerf.raindrop_attention.pairs import Batch, Patches
from baselines.training import supervised_training
from baselines.training.supervised_training import Intervals, Learner, SupervisedTraining, Validate, network_fingerprint

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
        super().__init__(config, learners, _fast(DerainGenerator(config.generator)))

    def _learn(self, batch: Batch) -> dict[str, Tensor]:
        """One step of the generator; where removal learns, one of the discriminator as well."""
        batch = Batch(*(plane.contiguous(memory_format=torch.channels_last) for plane in batch))
        removing = self.iteration % self.config.removal_every == 0
        return self._learn_all(batch) if removing else self._learn_attention(batch)

    def _learn_attention(self, batch: Batch) -> dict[str, Tensor]:
        with self._precision():
            maps = self.generator.maps(batch.rainy)
        loss = attention_loss(maps, batch.cover, self.config.losses.attention_decay)
        self._descend(GENERATOR, loss)
        return {"attention": loss}

    def _learn_all(self, batch: Batch) -> dict[str, Tensor]:
        self.discriminator.requires_grad_(False)
        with self._precision():
            found = self.generator(batch.rainy)
            judged = self.discriminator(found.frames.whole)
        losses = generator_losses(found, batch.clean, batch.cover, judged, self.config.losses)
        self._descend(GENERATOR, losses.total(self.config.losses))
        self.discriminator.requires_grad_(True)
        judgement = self._learn_discriminator(found.frames.whole.detach(), batch.clean, found.maps[-1].detach())
        return {**losses._asdict(), DISCRIMINATOR: judgement}

    def _learn_discriminator(self, derained: Tensor, clean: Tensor, attention: Tensor) -> Tensor:
        with self._precision():
            judged, real = self.discriminator(derained), self.discriminator(clean)
        loss = discriminator_loss(judged, real, attention, self.config.losses.discriminator_map)
        self._descend(DISCRIMINATOR, loss)
        return loss

    def _precision(self) -> torch.autocast:
        return torch.autocast("cpu", torch.bfloat16, enabled=self.config.precision == "bfloat16")


def _fast(network: nn.Module) -> Any:
    """Channels last: what convolutions on processors are quickest with."""
    return network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]


def train(
    folder: Path,
    config: TrainingConfig,
    patches: Patches,
    data: str,
    validate: Validate,
    intervals: Intervals,
    workers: int = 0,
) -> AttentionTraining:
    """Train in `folder`, from the checkpoint there if there is one; see `supervised_training.train`.

    Args:
        folder: gets the checkpoint and curve.csv.
        config: of the training.
        patches: to learn from.
        data: what they are, as it stands in the checkpoint; another one is refused.
        validate: scores of the averaged generator.
        intervals: between checkpoints and between validations.
        workers: processes that draw patches ahead.

    Raises:
        InputError: the checkpoint is damaged or of another training.
    """
    training, fingerprint = AttentionTraining(config), network_fingerprint(config, data)
    supervised_training.train(training, patches, folder, fingerprint, validate, intervals, workers)
    return training
