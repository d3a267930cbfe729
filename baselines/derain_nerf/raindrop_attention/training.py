"""Train generator and discriminator; an interrupted training goes on and ends with the same bits."""

import time
from pathlib import Path
from typing import Any

import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.utils import clip_grad_norm_

from baselines.derain_nerf.raindrop_attention.config import TrainingConfig, Upkeep
from baselines.derain_nerf.raindrop_attention.discriminator import Discriminator
from baselines.derain_nerf.raindrop_attention.losses import attention_loss, discriminator_loss, generator_losses
from baselines.derain_nerf.raindrop_attention.network import Generator
from baselines.derain_nerf.raindrop_attention.pairs import Batch, Patches
from baselines.training.checkpoints import check_fingerprint, read_arrays, write_arrays
from baselines.training.network_training import Validate, average_in, network_fingerprint, rate_at, resume, run
from baselines.training.torch_state import module_arrays, restore_module

SMOOTHING = 0.99  # of the losses that are shown
BETAS = {"generator": (0.9, 0.999), "discriminator": (0.5, 0.999)}  # of Adam


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

    @property
    def told(self) -> dict[str, float]:
        """The smoothed losses, for the curve."""
        return self.losses

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
        average_in(self.averaged, self.generator, self.step, self.config.averaging)
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

    def load_state_dict(self, path: Path, fingerprint: dict[str, Any]) -> None:
        """Take over what `save` wrote.

        Raises:
            InputError: damaged, or of another training.
        """
        arrays, about = read_arrays(path)
        check_fingerprint(path, about.get("fingerprint", {}), fingerprint)
        for name, (network, optimiser) in self._parts().items():
            own = {key.removeprefix(f"{name}/"): value for key, value in arrays.items() if key.startswith(f"{name}/")}
            restore_module(network, own, optimiser)
        for name, value in about["progress"].items():
            setattr(self, name, value)


def _fast(network: nn.Module) -> Any:
    """Channels last: what convolutions on processors are quickest with."""
    return network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]


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
    training, fingerprint = Training(config), network_fingerprint(config, data)
    resume(training, folder, fingerprint)
    batches = (patches[step] for step in range(training.step, config.steps))
    run(training, batches, config.steps, folder, fingerprint, validate, upkeep)
    return training
