"""Train an enhancement network; an interrupted training goes on and ends with the same bits."""

import math
import time
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from baselines.training.checkpoints import check_fingerprint, read_arrays, write_arrays
from baselines.training.network_training import Validate, average_in, network_fingerprint, rate_at, resume, run
from baselines.training.torch_state import module_arrays, restore_module
from deraings.enhancement.config import TrainingConfig, Upkeep
from deraings.enhancement.loss import cover_loss, enhancement_loss
from deraings.enhancement.mist_branch import crop_mist, mist_loss, without_mist
from deraings.enhancement.network import EnhancementNetwork
from deraings.enhancement.pairs import Pairs, Sample, batches
from deraings.enhancement.weights import to_arrays, to_tensors

AVERAGED = "averaged."  # before the names of the averaged weights in a checkpoint
SMOOTHING = 0.99  # of the loss that is shown


class Training:
    """A network, its averaged weights, its optimiser and how far it is."""

    def __init__(self, config: TrainingConfig) -> None:
        torch.manual_seed(config.seed)
        self.config = config
        self.network = EnhancementNetwork(config.network)
        self.averaged = EnhancementNetwork(config.network).requires_grad_(False)
        self.averaged.load_state_dict(self.network.state_dict())
        self.optimiser = torch.optim.AdamW(
            self.network.parameters(), config.rate, weight_decay=config.weight_decay, fused=True
        )
        self.step = 0
        self.seconds = 0.0
        self.loss = math.nan
        self.curve: list[dict[str, float]] = []

    @property
    def told(self) -> dict[str, float]:
        """The smoothed loss, for the curve."""
        return {"loss": self.loss}

    def begin_with(self, start: EnhancementNetwork) -> None:
        """Begin with a trained network of the same configuration instead of chance; the optimiser knows nothing yet."""
        for network in (self.network, self.averaged):
            network.load_state_dict(start.state_dict())

    def learn(self, batch: Sample) -> None:
        """One step."""
        start = time.perf_counter()
        rate = rate_at(self.step, self.config)
        for group in self.optimiser.param_groups:
            group["lr"] = rate
        self.optimiser.zero_grad(set_to_none=True)
        loss = self._loss(batch)
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), self.config.clip, error_if_nonfinite=True)
        self.optimiser.step()
        average_in(self.averaged, self.network, self.step, self.config.averaging)
        value = loss.item()
        self.loss = value if math.isnan(self.loss) else SMOOTHING * self.loss + (1 - SMOOTHING) * value
        self.step += 1
        self.seconds += time.perf_counter() - start

    def _loss(self, batch: Sample) -> Tensor:
        config, network, rainy, extra = self.config, self.network, batch.rainy, torch.zeros(())
        if config.network.mist:
            wholes = [whole.flatten(0, 1) for whole in (batch.whole_rainy, batch.whole_clean, batch.whole_veil)]
            veils = network.mist(wholes[0])
            extra = config.lifting * mist_loss(veils, *wholes)
            own = veils.unflatten(0, batch.whole_rainy.shape[:2])[:, 0]
            rainy = without_mist(rainy, crop_mist(own, batch.box, rainy.shape[-2], rainy.shape[-1]))
        with torch.autocast("cpu", torch.bfloat16, enabled=config.precision == "bfloat16"):
            features = network.features(rainy)
            enhanced = network.enhanced(rainy, features)
            found = network.alpha(features) if config.network.alpha else None
        if found is not None:
            extra = extra + config.detection * cover_loss(found.float(), batch.cover)
        weights = config.frequency, config.smooth, config.floor
        return extra + enhancement_loss(enhanced.float(), batch.clean, batch.rainy, *weights)

    def save(self, path: Path, fingerprint: dict[str, Any]) -> None:
        """Write all of it."""
        averaged = to_arrays({f"{AVERAGED}{name}": value for name, value in self.averaged.state_dict().items()})
        progress = {"step": self.step, "seconds": self.seconds, "loss": self.loss, "curve": self.curve}
        arrays = {**module_arrays(self.network, self.optimiser), **averaged}
        write_arrays(path, arrays, {"fingerprint": fingerprint, "progress": progress})

    def load_state_dict(self, path: Path, fingerprint: dict[str, Any]) -> None:
        """Take over what `save` wrote.

        Raises:
            InputError: damaged, or of another training.
        """
        arrays, about = read_arrays(path)
        check_fingerprint(path, about.get("fingerprint", {}), fingerprint)
        averaged = {name.removeprefix(AVERAGED): v for name, v in arrays.items() if name.startswith(AVERAGED)}
        self.averaged.load_state_dict(to_tensors(averaged))
        restore_module(self.network, arrays, self.optimiser)
        for name, value in about["progress"].items():
            setattr(self, name, value)


def train(
    folder: Path,
    config: TrainingConfig,
    pairs: Pairs,
    data: str,
    validate: Validate,
    upkeep: Upkeep,
    start: EnhancementNetwork | None = None,
) -> Training:
    """Train in `folder`, from the checkpoint there if there is one.

    Args:
        folder: gets the checkpoint and curve.csv.
        config: of the training.
        pairs: to learn from.
        data: what they are, as it stands in the checkpoint; another one is refused.
        validate: scores of the averaged network.
        upkeep: what does not change the result.
        start: a trained network of the same configuration to begin with.

    Raises:
        InputError: the checkpoint is damaged or of another training.
    """
    training, fingerprint = Training(config), network_fingerprint(config, data)
    if start is not None:
        training.begin_with(start)
    resume(training, folder, fingerprint)
    loader = batches(pairs, config.batch, training.step, config.steps, upkeep.workers)
    run(training, loader, config.steps, folder, fingerprint, validate, upkeep)
    return training
