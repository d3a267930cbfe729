"""What trainings of networks for single pictures share: rates, averages, the loop, checkpoints, files of weights."""

import csv
import io
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Protocol

import torch
from torch import Tensor, nn
from tqdm import tqdm

from hydroviews.errors import InputError
from hydroviews.files.atomic import listing, write_bytes

CHECKPOINT, CURVE = "checkpoint.safetensors", "curve.csv"

Validate = Callable[[Any], dict[str, float]]  # of averaged weights: what a row of the curve says beside losses


class Rates(Protocol):
    """Of a configuration of a training."""

    @property
    def steps(self) -> int: ...  # noqa: D102
    @property
    def rate(self) -> float: ...  # noqa: D102
    @property
    def final_rate(self) -> float: ...  # noqa: D102
    @property
    def warm_up(self) -> int: ...  # noqa: D102


class Upkeep(Protocol):
    """What trained weights do not depend on."""

    @property
    def checkpoint_every(self) -> int: ...  # noqa: D102
    @property
    def validate_every(self) -> int: ...  # noqa: D102


class Progress(Protocol):
    """A training: how far it is, and how it goes on."""

    step: int
    seconds: float
    curve: list[dict[str, float]]

    @property
    def averaged(self) -> nn.Module:
        """The network with averaged weights."""

    @property
    def told(self) -> dict[str, float]:
        """Smoothed losses by name; the first is shown while training."""

    def learn(self, batch: Any) -> None:
        """One step."""

    def save(self, path: Path, fingerprint: dict[str, Any]) -> None:
        """Write all of it."""

    def load_state_dict(self, path: Path, fingerprint: dict[str, Any]) -> None:
        """Take over what `save` wrote."""


def network_fingerprint(config: Any, data: str) -> dict[str, Any]:
    """What a checkpoint must agree with: the configuration, a dataclass, and in words what is learned from."""
    return {"configuration": asdict(config), "data": data}


def in_words(photographs: Sequence[Path], folder: Path) -> str:
    """What is learned from: how many photographs, of which folder, and their `listing`."""
    return f"{len(photographs)} photographs ({folder.parent.name}/{folder.name}, {listing(photographs)})"


def resume(training: Progress, folder: Path, fingerprint: dict[str, Any]) -> None:
    """Bring a new training as far as the checkpoint in a folder has come, if there is one.

    Raises:
        InputError: the checkpoint is damaged or of another training.
    """
    if (folder / CHECKPOINT).is_file():
        training.load_state_dict(folder / CHECKPOINT, fingerprint)


def run(
    training: Progress,
    batches: Iterable[Any],
    steps: int,
    folder: Path,
    fingerprint: dict[str, Any],
    validate: Validate,
    upkeep: Upkeep,
) -> None:
    """All steps that are left, with a checkpoint and a row of the curve in `folder` now and then and at the end."""
    with tqdm(total=steps, initial=training.step, desc="training", unit="step") as bar:
        for batch in batches:
            training.learn(batch)
            name, loss = next(iter(training.told.items()))
            bar.set_postfix_str(f"{name} {loss:.4f}", refresh=False)
            bar.update()
            last = training.step == steps
            if last or training.step % upkeep.validate_every == 0:
                note(training, validate, folder / CURVE)
            if last or training.step % upkeep.checkpoint_every == 0:
                training.save(folder / CHECKPOINT, fingerprint)


def note(training: Progress, validate: Validate, path: Path) -> None:
    """Validate, and write the curve so far."""
    row = {"step": training.step, "seconds": training.seconds, **training.told, **validate(training.averaged)}
    training.curve.append({name: round(value, 5) for name, value in row.items()})
    text = io.StringIO()
    writer = csv.DictWriter(text, list(row), lineterminator="\n")
    writer.writeheader()
    writer.writerows(training.curve)
    write_bytes(path, text.getvalue().encode())


def rate_at(step: int, config: Rates) -> float:
    """The learning rate of a step: up linearly, then down along half a cosine."""
    if step < config.warm_up:
        return config.rate * (step + 1) / config.warm_up
    done = (step - config.warm_up) / max(1, config.steps - config.warm_up)
    return config.final_rate + (config.rate - config.final_rate) * 0.5 * (1 + math.cos(math.pi * done))


@torch.no_grad()
def average_in(averaged: nn.Module, network: nn.Module, step: int, kept: float) -> None:
    """Move averaged weights towards a network's; they keep a share `kept` of themselves.

    Early weights are forgotten sooner, so that the average is worth something from the beginning.
    """
    kept = min(kept, (1 + step) / (10 + step))
    torch._foreach_lerp_(list(averaged.parameters()), list(network.parameters()), 1 - kept)


def rounded(tensors: dict[str, Tensor]) -> dict[str, Tensor]:
    """Weights as they come back from a file of half floats."""
    return {name: value.half().float() for name, value in tensors.items()}


def weights_file(weights: str | Path, shipped: Path, what: str) -> Path:
    """The file of the named weights in the folder `shipped`, or the file itself.

    Raises:
        InputError: none of that name are there; `what` says whose they would be.
    """
    if Path(weights).suffix:
        return Path(weights)
    path = shipped / f"{weights}.safetensors"
    if not path.is_file():
        names = ", ".join(sorted(file.stem for file in shipped.glob("*.safetensors")))
        raise InputError(
            f"{what} weights {weights}: none of that name are shipped",
            expected=f"one of: {names or 'none'}; or the path of a .safetensors file",
        )
    return path
