"""The training loop: schedule, steps, densification, checkpoints. What a step does is the backend's business."""

import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from baselines.splatting import schedule
from baselines.splatting.backends import Backend, make_backend
from baselines.splatting.checkpoints import fingerprint_of, read_checkpoint, write_checkpoint
from baselines.splatting.config import TrainerConfig
from baselines.splatting.gaussians import Gaussians
from baselines.splatting.initialisation import initialise, scene_extent
from baselines.splatting.kernels import warm_up
from baselines.splatting.objective import Objective, read_images
from baselines.splatting.state import TrainingState, fresh_state, without_broken
from hydroviews.cameras import Camera
from hydroviews.scenes import Scene

CHECKPOINT = "checkpoint.safetensors"
CHECK_EVERY = 100  # iterations between two looks for Gaussians that are not finite


@dataclass(frozen=True)
class Trained:
    """A trained scene."""

    gaussians: Gaussians
    near: float  # in world units
    seconds: float  # of training alone, over all sessions
    compile_seconds: float  # spent on loading or compiling kernels, in this session
    device: str
    extent: float
    broken: int = 0  # Gaussians removed because a parameter was NaN or infinite


def train(scene: Scene, config: TrainerConfig, seed: int, folder: Path, objective: Objective | None = None) -> Trained:
    """Learn the scene's training views, or go on from the checkpoint in `folder`.

    A run that was interrupted and taken up again ends with the same bits as one that was not.

    Args:
        scene: training views and points.
        config: settings.
        seed: of everything random.
        folder: where the checkpoint is kept.
        objective: what to compare with; the photographs themselves by default.

    Raises:
        InputError: an image that cannot be read; a checkpoint of another configuration, seed or scene; no such device.
        KeyboardInterrupt, SystemExit: on Ctrl-C and SIGTERM, after a checkpoint was written.
    """
    cameras = tuple(view.camera for view in scene.train_views)
    objective = objective or Objective(read_images(scene.train_views), config.ssim_share)
    extent = scene_extent(cameras)[1]
    near = config.near * extent
    backend = make_backend(config.device, objective, np.asarray(config.background, np.float32), near)
    compile_seconds = warm_up(config.sh_degree) if backend.device == "cpu" else 0.0

    fingerprint = {**fingerprint_of(config, seed, scene, objective), "device": backend.device}
    run = _Run(config, seed, cameras, extent, backend, objective, folder / CHECKPOINT, fingerprint)
    if run.checkpoint.exists():
        state, learnt = read_checkpoint(run.checkpoint, fingerprint)
        objective.restore(learnt)
    else:
        state = fresh_state(initialise(scene.points, cameras, config.sh_degree, seed))
    state = run.finish(state)
    return Trained(state.gaussians, near, state.seconds, compile_seconds, backend.device, extent, state.broken)


@dataclass(frozen=True)
class _Run:
    """What stays the same from the first step to the last."""

    config: TrainerConfig
    seed: int
    cameras: tuple[Camera, ...]
    extent: float
    backend: Backend
    objective: Objective
    checkpoint: Path
    fingerprint: dict[str, Any]

    def finish(self, state: TrainingState) -> TrainingState:
        """All steps that are left, with a checkpoint now and then and at the end."""
        backend, total = self.backend, self.config.iterations
        backend.put(state)
        clock = _Clock(state.seconds)
        saved, smooth, n = clock.seconds, 0.0, len(state.gaussians)
        bar = tqdm(total=total, initial=state.iteration, desc="training", unit="it", mininterval=1.0)
        with _stop_signals() as stopped, bar:
            for iteration in range(state.iteration, total):
                loss = self.step(iteration)
                if self.due(iteration):
                    state = self.change(backend.get(iteration + 1, clock.seconds))
                    backend.put(state)
                    n = len(state.gaussians)
                if stopped or clock.seconds - saved > self.config.checkpoint_seconds:
                    self.save(backend.get(iteration + 1, clock.seconds))
                    saved = clock.seconds
                if stopped:
                    raise KeyboardInterrupt if stopped[0] == signal.SIGINT else SystemExit(128 + stopped[0])
                smooth = 0.98 * smooth + 0.02 * loss if smooth else loss
                bar.set_postfix_str(f"loss {smooth:.4f}, {n} Gaussians", refresh=False)
                bar.update()
        state = backend.get(total, clock.seconds)
        self.save(state)
        return state

    def step(self, iteration: int) -> float:
        """One view; returns its loss."""
        config = self.config
        view = schedule.view_at(iteration, len(self.cameras), self.seed)
        camera = schedule.shrunk(
            self.cameras[view], schedule.shrink_at(iteration, config.iterations, config.resolutions)
        )
        degree = schedule.sh_degree_at(iteration, config.sh_every, config.sh_degree)
        rates = schedule.rates_at(iteration, config.iterations, config.rates, self.extent, config.sh_degree)
        duties = config.densification.duties(iteration, float(rates["means"]), self.extent, self.seed)
        return self.backend.step(camera, view, iteration, degree, rates, duties)

    def due(self, iteration: int) -> bool:
        """Whether anything but the parameters' values changes after step `iteration`."""
        done = iteration + 1
        checked = done % CHECK_EVERY == 0 or done == self.config.iterations
        return self.config.densification.due(iteration) or (checked and self.backend.broken() > 0)

    def change(self, state: TrainingState) -> TrainingState:
        """Broken Gaussians removed, then the strategy's refinement, after the state's last step."""
        iteration, strategy = state.iteration - 1, self.config.densification
        state = without_broken(state)
        return strategy.refine(state, self.extent, self.seed) if strategy.due(iteration) else state

    def save(self, state: TrainingState) -> None:
        """Write the checkpoint."""
        write_checkpoint(self.checkpoint, state, self.objective.arrays(), self.fingerprint)


class _Clock:
    """Seconds of training, going on from those of earlier sessions."""

    def __init__(self, before: float):
        self._zero = time.perf_counter() - before

    @property
    def seconds(self) -> float:
        return time.perf_counter() - self._zero


@contextmanager
def _stop_signals() -> Iterator[list[int]]:
    """Collects SIGINT and SIGTERM, so that a step is never cut in half; only the main thread may."""
    received: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        yield received
        return
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = {n: signal.signal(n, lambda number, _: received.append(number)) for n in numbers}
    try:
        yield received
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
