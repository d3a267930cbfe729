"""The training of an enhancement network."""

from pathlib import Path

import torch
from torch import Tensor

from baselines.training import supervised_training
from baselines.training.supervised_training import Intervals, Learner, SupervisedTraining, Validate, network_fingerprint
from deraings.enhancement.architecture.mist_branch import crop_mist, mist_loss, without_mist
from deraings.enhancement.architecture.network import EnhancementNetwork
from deraings.enhancement.training.config import TrainingConfig
from deraings.enhancement.training.loss import cover_loss, enhancement_loss, error_loss
from deraings.enhancement.training.pairs import Batches, Pairs, Sample

NETWORK = "network"  # the learner's name


class EnhancementTraining(SupervisedTraining):
    """A network, its averaged weights, its optimiser and how far they are."""

    config: TrainingConfig
    averaged: EnhancementNetwork

    def __init__(self, config: TrainingConfig, device: str = "cpu") -> None:
        """Begin with chance; the first weights are the same on every device."""
        torch.manual_seed(config.seed)
        self.network = EnhancementNetwork(config.network).to(device)
        optimiser = torch.optim.AdamW(
            self.network.parameters(), config.rate, weight_decay=config.weight_decay, fused=True
        )
        averaged = EnhancementNetwork(config.network).to(device)
        super().__init__(config, {NETWORK: Learner(self.network, optimiser)}, averaged)

    def begin_with(self, start: EnhancementNetwork) -> None:
        """Begin with a trained network instead of chance; the optimiser knows nothing yet.

        It has the same configuration, or no part yet that looks at lenses or predicts cover or its own error: such a
        part begins with chance.
        """
        for network in (self.network, self.averaged):
            network.load_state_dict(start.state_dict(), strict=network.config == start.config)
            if network.config.lens_mist and not start.config.lens_mist:
                network.lens_mist.load_state_dict(start.mist.state_dict(), strict=False)

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
        with torch.autocast(self.device.type, torch.bfloat16, enabled=config.precision == "bfloat16"):
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
        weights = config.frequency, config.smooth, config.floor
        return extra + enhancement_loss(enhanced.float(), batch.clean, batch.rainy, *weights)


def train(
    folder: Path,
    config: TrainingConfig,
    pairs: Pairs,
    data: str,
    validate: Validate,
    intervals: Intervals,
    start: EnhancementNetwork | None = None,
    workers: int = 0,
    device: str = "cpu",
) -> EnhancementTraining:
    """Train in `folder`, from the checkpoint there if there is one; see `supervised_training.train`.

    Args:
        folder: gets the checkpoint and curve.csv.
        config: of the training.
        pairs: to learn from.
        data: what they are, as it stands in the checkpoint; another one is refused.
        validate: scores of the averaged network.
        intervals: between checkpoints and between validations.
        start: a trained network of the same configuration to begin with.
        workers: processes that draw pairs ahead.
        device: of torch, where the network learns.

    Raises:
        InputError: the checkpoint is damaged or of another training.
    """
    training = EnhancementTraining(config, device)
    if start is not None:
        training.begin_with(start)
    batches, fingerprint = Batches(pairs, config.batch), network_fingerprint(config, data)
    supervised_training.train(training, batches, folder, fingerprint, validate, intervals, workers)
    return training
