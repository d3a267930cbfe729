"""The training loop: steps, what changes between them, checkpoints. What a step does is the backend's business."""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from baselines.splatting import schedule
from baselines.splatting.appearance.gaussians import with_appearance
from baselines.splatting.backends.base import Backend, make_backend
from baselines.splatting.backends.warm_up import warm_up
from baselines.splatting.config import TrainerConfig
from baselines.splatting.files.checkpoints import read_checkpoint, write_checkpoint
from baselines.splatting.gaussians import FEATURES, Gaussians
from baselines.splatting.initialisation import initialise, scene_extent
from baselines.splatting.objective import Objective
from baselines.splatting.state import TrainingState, fresh_state, without_non_finite
from baselines.splatting.strategies.pruning import prune
from baselines.training.checkpoints import fingerprint_of
from baselines.training.images import read_images
from baselines.training.stopping import Clock, Saving, end_stopped, stop_signals
from hydroviews.scene.cameras import Camera
from hydroviews.scene.scenes import Scene

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
    iterations: int | None = None  # that were done: fewer than configured where training stopped early
    residuals: tuple[float, ...] = ()  # mean losses of the held-in views, one a look
    non_finite: int = 0  # Gaussians removed because a parameter was NaN or infinite


def train(scene: Scene, config: TrainerConfig, seed: int, folder: Path, objective: Objective | None = None) -> Trained:
    """Learn the scene's training views, or go on from the checkpoint in `folder`.

    A run that was interrupted and taken up again ends with the same bits as one that was not, on the CPU.

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
    objective = objective or Objective(read_images(scene.train_views), config.lambda_dssim)
    extent = scene_extent(cameras)[1]
    near = config.near * extent
    backend = make_backend(
        config.device, objective, np.asarray(config.background, np.float32), near, config.antialiased
    )
    # On a GPU the plain loss is torch's; those of methods, and looks at held-in views, are kernels of the CPU.
    kernels = backend.device == "cpu" or not objective.is_photometric or config.early_stop
    compile_seconds = warm_up(config.sh_degree) if kernels else 0.0

    fingerprint = fingerprint_of(
        config, seed, scene, objective.images, objective=objective.settings(), device=backend.device
    )
    held = schedule.validation_views(len(cameras), config.early_stop.views) if config.early_stop else ()
    run = _Run(config, seed, cameras, held, extent, backend, objective, folder / CHECKPOINT, fingerprint)
    if run.checkpoint.exists():
        state, learnt = read_checkpoint(run.checkpoint, fingerprint)
        objective.load_state_dict(learnt)
    else:
        start = initialise(scene.points, cameras, config.sh_degree, seed)
        state = fresh_state(with_appearance(start, objective.appearance))
    state = run.finish(state)
    return Trained(
        gaussians=state.gaussians,
        near=near,
        seconds=state.seconds,
        compile_seconds=compile_seconds,
        device=backend.device,
        extent=extent,
        iterations=state.iteration,
        residuals=state.residuals,
        non_finite=state.non_finite,
    )


@dataclass(frozen=True)
class _Run:
    """What stays the same from the first step to the last."""

    config: TrainerConfig
    seed: int
    cameras: tuple[Camera, ...]
    held: tuple[int, ...]  # training views that are only looked at
    extent: float
    backend: Backend
    objective: Objective
    checkpoint: Path
    fingerprint: dict[str, Any]

    @cached_property
    def learnt(self) -> tuple[int, ...]:
        """The training views that steps learn from."""
        return tuple(view for view in range(len(self.cameras)) if view not in self.held)

    def finish(self, state: TrainingState) -> TrainingState:
        """All steps that are left, with a checkpoint now and then and at the end."""
        backend, total, done = self.backend, self.config.iterations, state.iteration
        backend.put(state)
        clock = Clock(state.seconds)
        saving, smooth = Saving(clock, self.config.checkpoint_seconds), 0.0
        bar = tqdm(total=total, initial=done, desc="training", unit="it", mininterval=1.0)
        with stop_signals() as stopped, bar:
            while done < total and not self.stalled(state):
                loss = self.step(done)
                done += 1
                if self.due(done):
                    state = self.change(backend.get(done, clock.seconds))
                if stopped or saving.due:
                    with saving.timed():
                        self.save(backend.get(done, clock.seconds))
                end_stopped(stopped)
                smooth = 0.98 * smooth + 0.02 * loss if smooth else loss
                bar.set_postfix_str(f"loss {smooth:.4f}, {len(state.gaussians)} Gaussians", refresh=False)
                bar.update()
        state = backend.get(done, clock.seconds)
        self.save(state)
        return state

    def step(self, iteration: int) -> float:
        """One view; returns its loss."""
        config = self.config
        view = self.learnt[schedule.view_at(iteration, len(self.learnt), self.seed)]
        shrink = schedule.shrink_at(iteration, config.iterations, config.resolutions)
        degree = schedule.sh_degree_at(iteration, config.sh_degree_interval, config.sh_degree)
        rates = schedule.rates_at(iteration, config.iterations, config.learning_rates, self.extent, config.sh_degree)
        if self.objective.appearance is not None:
            rates |= {FEATURES: self.objective.appearance.feature_rate(iteration)}
        step_options = config.strategy.step_options(iteration, float(rates["means"]), self.extent, self.seed)
        return self.backend.step(
            schedule.shrunk(self.cameras[view], shrink), view, iteration, degree, rates, step_options
        )

    def due(self, done: int) -> bool:
        """Whether `change` has anything to do after so many steps."""
        config = self.config
        checked = done % CHECK_EVERY == 0 or done == config.iterations
        pruned = config.pruning is not None and config.pruning.due(done - 1, config.iterations)
        refined = config.strategy.due(done - 1)
        return refined or pruned or self.looked(done) or (checked and self.backend.non_finite() > 0)

    def looked(self, done: int) -> bool:
        """Whether the held-in views are looked at after so many steps."""
        return self.config.early_stop is not None and done % self.config.early_stop.every == 0

    def change(self, state: TrainingState) -> TrainingState:
        """What is due between two steps: broken Gaussians out, refinement, pruning, a look at the held-in views."""
        config, backend, done = self.config, self.backend, state.iteration
        state = without_non_finite(state)
        if config.strategy.due(done - 1):
            state = config.strategy.refine(state, self.extent, self.seed)
        backend.put(state)
        if config.pruning and config.pruning.due(done - 1, config.iterations):
            left = config.pruning.left(done - 1, config.iterations)
            state = prune(state, backend.contributions(self.cameras), config.pruning, left)
            backend.put(state)
        if self.looked(done):
            degree = schedule.sh_degree_at(done - 1, config.sh_degree_interval, config.sh_degree)
            losses = [backend.residual(self.cameras[view], view, degree) for view in self.held]
            state = replace(state, residuals=(*state.residuals, float(np.mean(losses))))
            backend.put(state)
        return state

    def stalled(self, state: TrainingState) -> bool:
        """Whether the held-in views have not been matched better for too many looks."""
        early_stop, residuals = self.config.early_stop, state.residuals
        if early_stop is None or not residuals:
            return False
        return len(residuals) - 1 - int(np.argmin(residuals)) >= early_stop.patience

    def save(self, state: TrainingState) -> None:
        """Write the checkpoint."""
        write_checkpoint(self.checkpoint, state, self.objective.state_dict(), self.fingerprint)
