"""The training loop: steps, a clock over sessions, checkpoints, signals, progress. What a step does is the trainer's.

A training that was stopped and goes on ends as one that was left alone, if a trainer's step depends on nothing but
its state and `iteration`: whatever is random in step i is drawn from the seed and i.
"""

import math
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from threadpoolctl import threadpool_limits
from tqdm import tqdm

from baselines.training.checkpoints import Tree, load_checkpoint, save_checkpoint
from baselines.training.learning_curve import LEARNING_CURVE, LearningCurve, write_rows
from baselines.training.signals import Clock, Saving, end_stopped, stop_signals

_CURVE = "learning curve"  # in a checkpoint, beside the trainer's own
SMOOTHING = 0.98  # what the loss that is shown keeps of itself in a step

Interval = tuple[float, float]  # when a loop began and ended, seconds of `time.perf_counter`

_loops: ContextVar[list[Interval] | None] = ContextVar("loops", default=None)  # where `timed_loops` collects them

Metrics = Mapping[str, float]  # losses, as floats, and counts, as integers


class Resumable(Protocol):
    """A training that takes over a state."""

    def load_state_dict(self, tree: Tree) -> None:
        """Take over what `state_dict` gave."""


class Trainer(Resumable, Protocol):
    """What the loop needs to know of a training."""

    iterations: int  # steps, if training does not end early
    seconds: float  # of training, over all sessions; the loop keeps it, the state holds it

    @property
    def iteration(self) -> int:
        """Steps done."""

    @property
    def finished(self) -> bool:
        """Whether no step is left."""

    def step(self) -> Metrics:
        """Take step `iteration` and count it. The first loss and all counts are shown."""

    def state_dict(self) -> Tree:
        """All that the following steps depend on, and `iteration` and `seconds`; valid until the next step."""


def run(trainer: Trainer, checkpoint: Path, fingerprint: Mapping[str, Any], checkpoint_seconds: float) -> None:
    """Take all steps that are left, from the checkpoint if there is one.

    Args:
        trainer: in its first state.
        checkpoint: its file; written now and then, before the process ends on a signal, and at the end, with the
            learning curve so far beside it.
        fingerprint: what a checkpoint has to agree with.
        checkpoint_seconds: of training between two checkpoints, 0 for one after every step.

    Raises:
        InputError: the checkpoint is damaged, or of another training.
        FloatingPointError: a loss is NaN or infinite; the checkpoint is one from before that.
        KeyboardInterrupt, SystemExit: on Ctrl-C and SIGTERM, when the step is done and a checkpoint is written.
    """
    curve = LearningCurve(trainer.iterations)
    resume(_WithCurve(trainer, curve), checkpoint, fingerprint)
    clock = Clock(trainer.seconds)
    saving = Saving(clock, checkpoint_seconds)
    bar = tqdm(total=trainer.iterations, initial=trainer.iteration, desc="training", unit="it", mininterval=1.0)
    smooth: float | None = None
    with stop_signals() as stopped, bar, one_blas_thread(), _noted():
        while not trainer.finished:
            iteration, metrics = trainer.iteration, trainer.step()
            check_finite(metrics, iteration)
            trainer.seconds = clock.seconds
            curve.add(trainer.iteration, trainer.seconds, metrics, trainer.finished)
            if stopped or saving.due or trainer.finished:
                with saving.timed():
                    save_checkpoint(checkpoint, {**trainer.state_dict(), _CURVE: curve.state_dict()}, fingerprint)
                    write_rows(checkpoint.with_name(LEARNING_CURVE), curve.columns, curve.rows)
            end_stopped(stopped)
            smooth = smoothed(smooth, next(iter(metrics.values())), SMOOTHING)
            bar.set_postfix_str(_in_words(metrics, smooth), refresh=False)
            bar.update()


@dataclass(frozen=True)
class _WithCurve:
    """A trainer and its learning curve, as a checkpoint holds them."""

    trainer: Trainer
    curve: LearningCurve

    def load_state_dict(self, tree: Tree) -> None:
        self.trainer.load_state_dict(tree)
        if _CURVE in tree:  # older checkpoints lack it
            self.curve.load_state_dict(tree[_CURVE])


@contextmanager
def timed_loops() -> Iterator[list[Interval]]:
    """Collects when the loops in the block began and ended, to tell training from what is done before and after it."""
    loops: list[Interval] = []
    token = _loops.set(loops)
    try:
        yield loops
    finally:
        _loops.reset(token)


def one_blas_thread() -> threadpool_limits:
    """Limit BLAS to one thread: a step's matrices are small, and idle threads of BLAS spin."""
    return threadpool_limits(1, user_api="blas")


@contextmanager
def _noted() -> Iterator[None]:
    began = time.perf_counter()
    try:
        yield
    finally:
        loops = _loops.get()
        if loops is not None:
            loops.append((began, time.perf_counter()))


def resume(training: Resumable, checkpoint: Path, fingerprint: Mapping[str, Any]) -> None:
    """Bring a new training to where its checkpoint stands, if there is one.

    Raises:
        InputError: the checkpoint is damaged, or of another training.
    """
    if checkpoint.is_file():
        training.load_state_dict(load_checkpoint(checkpoint, fingerprint))


def check_finite(losses: Metrics, iteration: int) -> None:
    """Refuse losses of a step that are not finite.

    Raises:
        FloatingPointError: one is NaN or infinite.
    """
    if not all(math.isfinite(loss) for loss in losses.values()):
        found = ", ".join(f"{name} {loss:g}" for name, loss in losses.items())
        raise FloatingPointError(f"the loss of iteration {iteration} is not finite: {found}")


def smoothed(before: float | None, value: float, kept: float) -> float:
    """An exponential average after one more value, of which it keeps the share `kept`; it begins with the first."""
    return value if before is None else kept * before + (1 - kept) * value


def _in_words(metrics: Metrics, smooth: float) -> str:
    """The first loss, smoothed, and all counts."""
    counts = [f"{value} {name}" for name, value in metrics.items() if isinstance(value, int)]
    return ", ".join([f"{next(iter(metrics))} {smooth:.4f}", *counts])
