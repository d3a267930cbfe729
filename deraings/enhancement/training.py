"""Train an enhancement network; an interrupted training goes on and ends with the same bits."""

import csv
import io
import json
import math
import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import torch
from torch import Tensor
from tqdm import tqdm

from baselines.splatting.checkpoints import read_arrays, write_arrays
from baselines.torch_state import module_arrays, restore_module
from deraings.enhancement.config import TrainingConfig, Upkeep
from deraings.enhancement.loss import cover_loss, enhancement_loss
from deraings.enhancement.network import EnhancementNetwork
from deraings.enhancement.pairs import Pairs, Sample, batches
from deraings.enhancement.veil import cut, lifted, veil_loss
from deraings.enhancement.weights import to_arrays, to_tensors
from hydroviews.errors import InputError
from hydroviews.files import write_bytes

CHECKPOINT, CURVE = "checkpoint.safetensors", "curve.csv"
AVERAGED = "averaged."  # before the names of the averaged weights in a checkpoint
SMOOTHING = 0.99  # of the loss that is shown

Validate = Callable[[EnhancementNetwork], dict[str, float]]  # what a row of the curve says beside step, loss and rate


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
        self._average()
        value = loss.item()
        self.loss = value if math.isnan(self.loss) else SMOOTHING * self.loss + (1 - SMOOTHING) * value
        self.step += 1
        self.seconds += time.perf_counter() - start

    def _loss(self, batch: Sample) -> Tensor:
        config, network, rainy, extra = self.config, self.network, batch.rainy, torch.zeros(())
        if config.network.veil:
            wholes = [whole.flatten(0, 1) for whole in (batch.whole_rainy, batch.whole_clean, batch.whole_veil)]
            veils = network.veil(wholes[0])
            extra = config.lifting * veil_loss(veils, *wholes)
            own = veils.unflatten(0, batch.whole_rainy.shape[:2])[:, 0]
            rainy = lifted(rainy, cut(own, batch.box, rainy.shape[-2], rainy.shape[-1]))
        with torch.autocast("cpu", torch.bfloat16, enabled=config.precision == "bfloat16"):
            features = network.features(rainy)
            enhanced = network.enhanced(rainy, features)
            found = network.cover(features) if config.network.cover else None
        if found is not None:
            extra = extra + config.detection * cover_loss(found.float(), batch.cover)
        weights = config.frequency, config.smooth, config.floor
        return extra + enhancement_loss(enhanced.float(), batch.clean, batch.rainy, *weights)

    def _average(self) -> None:
        """Early weights are forgotten sooner, so that the average is worth something from the beginning."""
        kept = min(self.config.averaging, (1 + self.step) / (10 + self.step))
        with torch.no_grad():
            torch._foreach_lerp_(list(self.averaged.parameters()), list(self.network.parameters()), 1 - kept)

    def save(self, path: Path, fingerprint: dict[str, Any]) -> None:
        """Write all of it."""
        averaged = to_arrays({f"{AVERAGED}{name}": value for name, value in self.averaged.state_dict().items()})
        progress = {"step": self.step, "seconds": self.seconds, "loss": self.loss, "curve": self.curve}
        arrays = {**module_arrays(self.network, self.optimiser), **averaged}
        write_arrays(path, arrays, {"fingerprint": fingerprint, "progress": progress})

    def restore(self, path: Path, fingerprint: dict[str, Any]) -> None:
        """Take over what `save` wrote.

        Raises:
            InputError: damaged, or of another training.
        """
        arrays, about = read_arrays(path)
        found, expected = about.get("fingerprint"), json.loads(json.dumps(fingerprint))
        if found != expected:
            raise InputError(
                f"{path}: the checkpoint is of another training",
                found=found,
                expected=expected,
                fix="train in another folder, or remove the checkpoint to start again",
            )
        averaged = {name.removeprefix(AVERAGED): v for name, v in arrays.items() if name.startswith(AVERAGED)}
        self.averaged.load_state_dict(to_tensors(averaged))
        restore_module(self.network, arrays, self.optimiser)
        for name, value in about["progress"].items():
            setattr(self, name, value)


def rate_at(step: int, config: TrainingConfig) -> float:
    """The learning rate of a step: up linearly, then down along half a cosine."""
    if step < config.warm_up:
        return config.rate * (step + 1) / config.warm_up
    done = (step - config.warm_up) / max(1, config.steps - config.warm_up)
    return config.final_rate + (config.rate - config.final_rate) * 0.5 * (1 + math.cos(math.pi * done))


def fingerprint_of(config: TrainingConfig, data: str) -> dict[str, Any]:
    """What a checkpoint must agree with."""
    return {"configuration": asdict(config), "data": data}


def resume(folder: Path, config: TrainingConfig, data: str) -> Training:
    """The training in a folder as far as it is, from the beginning if nothing is there.

    Raises:
        InputError: the checkpoint is damaged or of another training.
    """
    training, checkpoint = Training(config), folder / CHECKPOINT
    if checkpoint.is_file():
        training.restore(checkpoint, fingerprint_of(config, data))
    return training


def train(
    folder: Path,
    config: TrainingConfig,
    pairs: Pairs,
    data: str,
    validate: Validate,
    upkeep: Upkeep,
) -> Training:
    """Train in `folder`, from the checkpoint there if there is one.

    Args:
        folder: gets the checkpoint and curve.csv.
        config: of the training.
        pairs: to learn from.
        data: what they are, as it stands in the checkpoint; another one is refused.
        validate: scores of the averaged network.
        upkeep: what does not change the result.

    Raises:
        InputError: the checkpoint is damaged or of another training.
    """
    training, fingerprint, checkpoint = resume(folder, config, data), fingerprint_of(config, data), folder / CHECKPOINT
    loader = batches(pairs, config.batch, training.step, config.steps, upkeep.workers)
    with tqdm(total=config.steps, initial=training.step, desc="training", unit="step") as bar:
        for batch in loader:
            training.learn(batch)
            bar.set_postfix(loss=f"{training.loss:.4f}", refresh=False)
            bar.update()
            last = training.step == config.steps
            if last or training.step % upkeep.validate_every == 0:
                _note(training, validate, folder / CURVE)
            if last or training.step % upkeep.checkpoint_every == 0:
                training.save(checkpoint, fingerprint)
    return training


def _note(training: Training, validate: Validate, path: Path) -> None:
    """Validate, and write the curve so far."""
    scores = validate(training.averaged)
    row = {"step": training.step, "seconds": training.seconds, "loss": training.loss, **scores}
    training.curve.append({name: round(value, 5) for name, value in row.items()})
    text = io.StringIO()
    writer = csv.DictWriter(text, list(row), lineterminator="\n")
    writer.writeheader()
    writer.writerows(training.curve)
    write_bytes(path, text.getvalue().encode())
