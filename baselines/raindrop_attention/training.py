"""Train generator and discriminator; an interrupted training goes on and ends with the same bits."""

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
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.utils import clip_grad_norm_
from tqdm import tqdm

from baselines.raindrop_attention.config import TrainingConfig, Upkeep
from baselines.raindrop_attention.discriminator import Discriminator
from baselines.raindrop_attention.losses import attention_loss, discriminator_loss, generator_losses
from baselines.raindrop_attention.network import Generator
from baselines.raindrop_attention.pairs import Batch, Patches
from baselines.splatting.checkpoints import read_arrays, write_arrays
from baselines.torch_state import module_arrays, restore_module
from hydroviews.errors import InputError
from hydroviews.files import write_bytes

CHECKPOINT, CURVE = "checkpoint.safetensors", "curve.csv"
SMOOTHING = 0.99  # of the losses that are shown
BETAS = {"generator": (0.9, 0.999), "discriminator": (0.5, 0.999)}  # of Adam

Validate = Callable[[Generator], dict[str, float]]  # what a row of the curve says beside step, losses and rate


class Training:
    """Both networks, the generator's averaged weights, the optimisers and how far they are."""

    def __init__(self, config: TrainingConfig) -> None:
        torch.manual_seed(config.seed)
        self.config = config
        self.generator = _fast(Generator(config.generator))
        self.discriminator = _fast(Discriminator(config.discriminator))
        self.averaged = _fast(Generator(config.generator)).requires_grad_(False)
        self.averaged.load_state_dict(self.generator.state_dict())
        learning = {"generator": self.generator, "discriminator": self.discriminator}
        self.optimisers = {
            name: torch.optim.Adam(network.parameters(), config.rate, BETAS[name]) for name, network in learning.items()
        }
        self.step = 0
        self.seconds = 0.0
        self.losses: dict[str, float] = {}
        self.curve: list[dict[str, float]] = []

    def learn(self, batch: Batch) -> None:
        """One step of the generator; where removal learns, one of the discriminator as well."""
        start = time.perf_counter()
        for optimiser in self.optimisers.values():
            for group in optimiser.param_groups:
                group["lr"] = rate_at(self.step, self.config)
        batch = Batch(*(plane.contiguous(memory_format=torch.channels_last) for plane in batch))
        removing = self.step % self.config.removal_every == 0
        for name, value in (self._learn_all(batch) if removing else self._learn_attention(batch)).items():
            self.losses[name] = SMOOTHING * self.losses.get(name, value.item()) + (1 - SMOOTHING) * value.item()
        self._average()
        self.step += 1
        self.seconds += time.perf_counter() - start

    def _learn_attention(self, batch: Batch) -> dict[str, Tensor]:
        with self._precision():
            maps = self.generator.maps(batch.rainy)
        loss = attention_loss(maps, batch.cover, self.config.losses.attention_decay)
        self._descend("generator", self.generator, loss)
        return {"attention": loss}

    def _learn_all(self, batch: Batch) -> dict[str, Tensor]:
        self.discriminator.requires_grad_(False)
        with self._precision():
            found = self.generator(batch.rainy)
            judged = self.discriminator(found.frames.whole)
        losses = generator_losses(found, batch.clean, batch.cover, judged, self.config.losses)
        self._descend("generator", self.generator, losses.total(self.config.losses))
        self.discriminator.requires_grad_(True)
        told = self._learn_to_judge(found.frames.whole.detach(), batch.clean, found.maps[-1].detach())
        return {**losses._asdict(), "discriminator": told}

    def _learn_to_judge(self, derained: Tensor, clean: Tensor, attention: Tensor) -> Tensor:
        with self._precision():
            judged, real = self.discriminator(derained), self.discriminator(clean)
        loss = discriminator_loss(judged, real, attention, self.config.losses.discriminator_map)
        self._descend("discriminator", self.discriminator, loss)
        return loss

    def _precision(self) -> torch.autocast:
        return torch.autocast("cpu", torch.bfloat16, enabled=self.config.precision == "bfloat16")

    def _descend(self, name: str, network: nn.Module, loss: Tensor) -> None:
        self.optimisers[name].zero_grad(set_to_none=True)
        loss.backward()
        clip_grad_norm_(network.parameters(), self.config.clip, error_if_nonfinite=True)
        self.optimisers[name].step()

    def _average(self) -> None:
        """Early weights are forgotten sooner, so that the average is worth something from the beginning."""
        kept = min(self.config.averaging, (1 + self.step) / (10 + self.step))
        with torch.no_grad():
            torch._foreach_lerp_(list(self.averaged.parameters()), list(self.generator.parameters()), 1 - kept)

    def _parts(self) -> dict[str, tuple[nn.Module, torch.optim.Optimizer | None]]:
        learning = {name: (getattr(self, name), optimiser) for name, optimiser in self.optimisers.items()}
        return {**learning, "averaged": (self.averaged, None)}

    def save(self, path: Path, fingerprint: dict[str, Any]) -> None:
        """Write all of it."""
        arrays: dict[str, NDArray] = {}
        for name, part in self._parts().items():
            arrays |= {f"{name}/{key}": value for key, value in module_arrays(*part).items()}
        progress = {name: getattr(self, name) for name in ("step", "seconds", "losses", "curve")}
        write_arrays(path, arrays, {"fingerprint": fingerprint, "progress": progress})

    def restore(self, path: Path, fingerprint: dict[str, Any]) -> None:
        """Take over what `save` wrote.

        Raises:
            InputError: damaged, or of another training.
        """
        arrays, about = read_arrays(path)
        found, expected = about.get("fingerprint"), json.loads(json.dumps(fingerprint))
        if found != expected:
            fix = "train in another folder, or remove the checkpoint to start again"
            what = f"{path}: the checkpoint is of another training"
            raise InputError(what, found=found, expected=expected, fix=fix)
        for name, (network, optimiser) in self._parts().items():
            own = {key.removeprefix(f"{name}/"): value for key, value in arrays.items() if key.startswith(f"{name}/")}
            restore_module(network, own, optimiser)
        for name, value in about["progress"].items():
            setattr(self, name, value)


def _fast(network: nn.Module) -> Any:
    """Channels last: what convolutions on processors are quickest with."""
    return network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]


def rate_at(step: int, config: TrainingConfig) -> float:
    """The learning rate of a step: up linearly, then down along half a cosine."""
    if step < config.warm_up:
        return config.rate * (step + 1) / config.warm_up
    done = (step - config.warm_up) / max(1, config.steps - config.warm_up)
    return config.final_rate + (config.rate - config.final_rate) * 0.5 * (1 + math.cos(math.pi * done))


def resume(folder: Path, config: TrainingConfig, data: str) -> Training:
    """The training in a folder as far as it is, from the beginning if nothing is there.

    Raises:
        InputError: the checkpoint is damaged or of another training.
    """
    training, checkpoint = Training(config), folder / CHECKPOINT
    if checkpoint.is_file():
        training.restore(checkpoint, _fingerprint(config, data))
    return training


def _fingerprint(config: TrainingConfig, data: str) -> dict[str, Any]:
    return {"configuration": asdict(config), "data": data}


def train(
    folder: Path, config: TrainingConfig, patches: Patches, data: str, validate: Validate, upkeep: Upkeep
) -> Training:
    """Train in `folder`, from the checkpoint there if there is one.

    Args:
        folder: gets the checkpoint and curve.csv.
        config: of the training.
        patches: to learn from.
        data: what they are, as it stands in the checkpoint; another one is refused.
        validate: scores of the averaged generator.
        upkeep: what does not change the result.

    Raises:
        InputError: the checkpoint is damaged or of another training.
    """
    training, fingerprint = resume(folder, config, data), _fingerprint(config, data)
    with tqdm(total=config.steps, initial=training.step, desc="training", unit="step") as bar:
        while training.step < config.steps:
            training.learn(patches[training.step])
            bar.set_postfix(attention=f"{training.losses['attention']:.4f}", refresh=False)
            bar.update()
            last = training.step == config.steps
            if last or training.step % upkeep.validate_every == 0:
                _note(training, validate, folder / CURVE)
            if last or training.step % upkeep.checkpoint_every == 0:
                training.save(folder / CHECKPOINT, fingerprint)
    return training


def _note(training: Training, validate: Validate, path: Path) -> None:
    """Validate, and write the curve so far."""
    row = {"step": training.step, "seconds": training.seconds, **training.losses, **validate(training.averaged)}
    training.curve.append({name: round(value, 5) for name, value in row.items()})
    text = io.StringIO()
    writer = csv.DictWriter(text, list(row), lineterminator="\n")
    writer.writeheader()
    writer.writerows(training.curve)
    write_bytes(path, text.getvalue().encode())
