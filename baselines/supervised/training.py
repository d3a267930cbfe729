"""The training of networks from pairs: rates, averaged weights, smoothed losses, validation, a curve.

A network's training derives from `SupervisedTraining` and says how a batch is learned from. Batches are functions of
their step alone, so that a training that was stopped resumes exactly.
"""

import math
import signal
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from copy import deepcopy
from dataclasses import asdict
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, Protocol, cast

import torch
from torch import Tensor, nn
from torch.nn.utils import clip_grad_norm_
from torch.utils.data import DataLoader, Dataset

from baselines.supervised.config import Intervals, SupervisedConfig
from baselines.training import loop
from baselines.training.checkpoints import CHECKPOINT, Tree
from baselines.training.learning_curve import write_rows
from baselines.training.torch_state import module_arrays, restore_module

CURVE = "curve.csv"
SMOOTHING = 0.99  # what the losses of the curve keep of themselves in a step
FINAL_RATE = 1e-6  # learning rate at the end of the cosine

Validate = Callable[[Any], dict[str, float]]  # of the averaged network: a row of the curve, beside losses


class Batches(Protocol):
    """Batches by step; the same step gives the same batch, in whatever process and order."""

    def __getitem__(self, step: int) -> Any:
        """A tensor, or a tuple of tensors."""


class Learner(NamedTuple):
    """A network, and what changes it."""

    network: nn.Module
    optimiser: torch.optim.Optimizer


class SupervisedTraining(ABC):
    """Networks with their optimisers, averaged weights of the first of them, and how far they are."""

    clip: ClassVar[float] = 1.0  # largest norm of a step's gradient

    def __init__(self, config: SupervisedConfig, learners: Mapping[str, Learner]) -> None:
        """Begin with networks as they are."""
        self.config, self.learners = config, learners
        self.averaged: Any = deepcopy(self._first).requires_grad_(False)
        self.iteration, self.seconds = 0, 0.0
        self.losses: dict[str, float] = {}  # smoothed
        self.curve: list[dict[str, float]] = []

    @property
    def _first(self) -> nn.Module:
        return next(iter(self.learners.values())).network

    @property
    def device(self) -> torch.device:
        """Where the networks learn."""
        return next(self._first.parameters()).device

    def fingerprint(self, data: str) -> dict[str, Any]:
        """The identity of a training, which its checkpoint must have: the configuration, and the data in words."""
        return {"configuration": asdict(self.config), "data": data}

    def learn(self, batch: Any) -> dict[str, float]:
        """Take one step; returns the smoothed losses. The batch may be on any device.

        Raises:
            FloatingPointError: a gradient is NaN or infinite; no weights were changed by it.
        """
        rate = rate_at(self.iteration, self.config)
        for learner in self.learners.values():
            for group in learner.optimiser.param_groups:
                group["lr"] = rate
        for name, loss in self._learn(moved(batch, self.device)).items():
            self.losses[name] = loop.smoothed(self.losses.get(name), loss.item(), SMOOTHING)
        average_in(self.averaged, self._first, self.iteration, self.config.averaging)
        self.iteration += 1
        return self.losses

    @abstractmethod
    def _learn(self, batch: Any) -> dict[str, Tensor]:
        """Change the networks by `_descend`; returns the losses, the one to be shown first."""

    def _autocast(self) -> torch.autocast:
        """The precision of convolutions and attention, while it lasts."""
        return torch.autocast(self.device.type, torch.bfloat16, enabled=self.config.precision == "bfloat16")

    def _descend(self, name: str, loss: Tensor) -> None:
        """One step of a network's optimiser down a loss."""
        network, optimiser = self.learners[name]
        optimiser.zero_grad(set_to_none=True)
        loss.backward()
        norm = clip_grad_norm_(network.parameters(), self.clip)
        if not norm.isfinite():
            raise FloatingPointError(
                f"the {name}'s gradient of iteration {self.iteration} is not finite: loss {loss.item():g}"
            )
        optimiser.step()

    def state_dict(self) -> Tree:
        """All of it."""
        return {
            **{name: getattr(self, name) for name in ("iteration", "seconds", "losses", "curve")},
            "learners": {name: module_arrays(*learner) for name, learner in self.learners.items()},
            "averaged": module_arrays(self.averaged),
        }

    def load_state_dict(self, tree: Tree) -> None:
        """Take over what `state_dict` gave."""
        for name, learner in self.learners.items():
            restore_module(learner.network, tree["learners"][name], learner.optimiser)
        restore_module(self.averaged, tree["averaged"])
        for name in ("iteration", "seconds", "losses", "curve"):
            setattr(self, name, tree[name])


class _Trainer:
    """A training with what it learns from, as the loop wants it."""

    def __init__(
        self, training: SupervisedTraining, batches: Batches, workers: int, validate: Validate, every: int, curve: Path
    ) -> None:
        self._training, self._batches, self._workers = training, batches, workers
        self._validate, self._every, self._curve = validate, every, curve
        self._drawn: Iterator[Any] | None = None
        self.iterations = training.config.steps

    @property
    def iteration(self) -> int:
        return self._training.iteration

    @property
    def seconds(self) -> float:
        return self._training.seconds

    @seconds.setter
    def seconds(self, value: float) -> None:
        self._training.seconds = value

    @property
    def finished(self) -> bool:
        return self.iteration >= self.iterations

    def step(self) -> loop.Metrics:
        """Learn from the next batch, and validate where that is due."""
        if self._drawn is None:  # not before the loop handles signals, which workers take over
            self._drawn = draw_ahead(self._batches, self.iteration, self.iterations, self._workers)
        losses = self._training.learn(next(self._drawn))
        if self.finished or self.iteration % self._every == 0:
            note(self._training, self._validate, self._curve)
        return losses

    def end(self) -> None:
        """End the workers. Those that are left to the garbage collector are waited for: five seconds each."""
        self._drawn = None

    def state_dict(self) -> Tree:
        return self._training.state_dict()

    def load_state_dict(self, tree: Tree) -> None:
        self._training.load_state_dict(tree)


def train(
    training: SupervisedTraining,
    batches: Batches,
    folder: Path,
    data: str,
    validate: Validate,
    intervals: Intervals,
    workers: int = 0,
) -> None:
    """Take all steps that are left, in `folder`, from the checkpoint there if there is one.

    Args:
        training: in its first state.
        batches: to learn from.
        folder: gets the checkpoint and curve.csv.
        data: what the batches are, in words; a checkpoint of other data is refused.
        validate: scores of the averaged network.
        intervals: between checkpoints and between validations.
        workers: processes that draw batches ahead; 0 for none but this one.

    Raises:
        InputError: the checkpoint is damaged or of another training.
        FloatingPointError: a loss or gradient is NaN or infinite.
        KeyboardInterrupt, SystemExit: on Ctrl-C and SIGTERM, when the step is done and a checkpoint is written.
    """
    trainer = _Trainer(training, batches, workers, validate, intervals.validate_every, folder / CURVE)
    try:
        loop.run(trainer, folder / CHECKPOINT, training.fingerprint(data), intervals.checkpoint_seconds)
    finally:
        trainer.end()


def draw_ahead(batches: Batches, first: int, last: int, workers: int) -> Iterator[Any]:
    """The batches of steps `first` to `last` - 1, drawn ahead by so many processes; by this one if there are none."""
    dataset = cast("Dataset[Any]", batches)
    return iter(
        DataLoader(
            dataset, batch_size=None, sampler=range(first, last), num_workers=workers, worker_init_fn=_ignore_ctrl_c
        )
    )


def moved(batch: Any, device: torch.device) -> Any:
    """A tensor, or a named tuple of tensors, on a device."""
    if isinstance(batch, Tensor):
        return batch.to(device)
    return type(batch)(*(part.to(device) for part in batch))


def _ignore_ctrl_c(_: int) -> None:
    """A terminal sends Ctrl-C to workers as well, and the step that it interrupts needs their batch."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)


def note(training: SupervisedTraining, validate: Validate, path: Path) -> None:
    """Validate, and write the curve so far."""
    scores = validate(training.averaged)
    row = {"step": training.iteration, "seconds": training.seconds, **training.losses, **scores}
    training.curve.append({name: round(value, 5) for name, value in row.items()})
    columns = list(row)
    write_rows(path, columns, ([earlier[name] for name in columns] for earlier in training.curve))


def rate_at(step: int, config: SupervisedConfig) -> float:
    """The learning rate of a step: up linearly, then down along half a cosine."""
    if step < config.warm_up:
        return config.rate * (step + 1) / config.warm_up
    done = (step - config.warm_up) / max(1, config.steps - config.warm_up)
    return FINAL_RATE + (config.rate - FINAL_RATE) * 0.5 * (1 + math.cos(math.pi * done))


@torch.no_grad()
def average_in(averaged: nn.Module, network: nn.Module, step: int, kept: float) -> None:
    """Move averaged weights towards a network's; they keep a share `kept` of themselves.

    Early weights are forgotten sooner, so that the average is worth something from the beginning.
    """
    kept = min(kept, (1 + step) / (10 + step))
    torch._foreach_lerp_(list(averaged.parameters()), list(network.parameters()), 1 - kept)
