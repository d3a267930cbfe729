"""The training of Gaussians: a step, and what changes between two. How a step is calculated is the backend's."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from baselines.splatting import schedule
from baselines.splatting.appearance.gaussians import with_appearance
from baselines.splatting.backends.base import Backend, make_backend
from baselines.splatting.backends.warm_up import warm_up
from baselines.splatting.config import TrainerConfig
from baselines.splatting.files.checkpoints import state_from_tree, state_to_tree
from baselines.splatting.gaussians import FEATURES, Gaussians
from baselines.splatting.objective import Objective
from baselines.splatting.rasterizer import BLACK
from baselines.splatting.state import TrainingState, fresh_state, without_non_finite
from baselines.splatting.strategies.initialisation import initialise, scene_extent
from baselines.splatting.strategies.pruning import prune
from baselines.training.checkpoints import CHECKPOINT, Tree, fingerprint_of, settings_of
from baselines.training.images import evenly_spread, read_images
from baselines.training.loop import Metrics, run
from hydroviews.scene.cameras import Camera
from hydroviews.scene.scenes import Scene

KEPT_CAMERAS = 30  # of the training views, with the trained scene
CHECK_EVERY = 100  # iterations between two checks for Gaussians that are not finite


@dataclass(frozen=True)
class TrainedScene:
    """A trained scene."""

    gaussians: Gaussians
    near: float  # in world units
    seconds: float  # of training alone, over all sessions
    compile_seconds: float  # spent on loading or compiling kernels, in this session
    device: str
    extent: float
    iterations: int | None = None  # that were done: fewer than configured where training stopped early
    residuals: tuple[float, ...] = ()  # mean losses of the validation views, one a validation
    non_finite: int = 0  # Gaussians removed because a parameter was NaN or infinite
    cameras: tuple[Camera, ...] = ()  # some of the training views', evenly spread; none of a model of before


def train(
    scene: Scene,
    config: TrainerConfig,
    seed: int,
    folder: Path,
    objective: Objective | None = None,
    settings: Mapping[str, Any] | None = None,
) -> TrainedScene:
    """Learn the scene's training views, or go on from the checkpoint in `folder`.

    A run that was interrupted and goes on ends with the same bits as one that was not, on the CPU.

    Args:
        scene: training views and points.
        config: settings.
        seed: of everything random.
        folder: where the checkpoint is kept.
        objective: what to compare with; the photographs themselves by default.
        settings: of the whole method, for JSON; those of `config` by default. Checkpoints of others are refused.

    Raises:
        InputError: an image that cannot be read; a checkpoint of another configuration, seed or scene; no such device.
        FloatingPointError: a loss is NaN or infinite, or no Gaussian is left.
        KeyboardInterrupt, SystemExit: on Ctrl-C and SIGTERM, after a checkpoint was written.
    """
    cameras = tuple(view.camera for view in scene.train_views)
    objective = objective or Objective(read_images(scene.train_views), config.lambda_dssim)
    extent = scene_extent(cameras, scene.points.positions)[1]
    near = config.near * extent
    backend = make_backend(config.device, objective, BLACK, near, config.antialiased)
    # On a GPU the photometric loss is Triton's; what methods add, and the validation's, are kernels of the CPU.
    kernels = backend.device == "cpu" or objective.wants_kernels or config.early_stop
    compile_seconds = warm_up(config.sh_degree, objective.sh_sets) if kernels else 0.0

    place = "cpu" if backend.device == "cpu" else "cuda"  # another card may go on: no two runs on one are equal either
    fingerprint = fingerprint_of(
        settings or settings_of(config), seed, scene, objective.images, objective=objective.settings(), device=place
    )
    validation_views = schedule.validation_views(len(cameras), config.early_stop.views) if config.early_stop else ()
    budget = config.strategy.budget
    fewest = round(config.dense_start * budget)
    first = initialise(scene.points, cameras, config.sh_degree, seed, fewest, budget)
    start = with_appearance(first, objective.appearance)
    trainer = SplattingTrainer(config, seed, cameras, validation_views, extent, backend, objective, start)
    run(trainer, folder / CHECKPOINT, fingerprint, config.checkpoint_seconds)
    state = trainer.state
    if not len(state.gaussians):
        raise FloatingPointError(f"no Gaussian is left after {state.iteration} iterations: the model would be empty")
    return TrainedScene(
        gaussians=state.gaussians,
        near=near,
        seconds=state.seconds,
        compile_seconds=compile_seconds,
        device=backend.device,
        extent=extent,
        iterations=state.iteration,
        residuals=state.residuals,
        non_finite=state.non_finite,
        cameras=tuple(cameras[i] for i in evenly_spread(len(cameras), KEPT_CAMERAS)),
    )


class SplattingTrainer:
    """Gaussians that learn the training views; see `baselines.training.loop.Trainer`."""

    def __init__(
        self,
        config: TrainerConfig,
        seed: int,
        cameras: tuple[Camera, ...],
        validation_views: tuple[int, ...],
        extent: float,
        backend: Backend,
        objective: Objective,
        start: Gaussians,
    ) -> None:
        """Begin with given Gaussians.

        Args:
            config: settings.
            seed: of everything random.
            cameras: of the training views.
            validation_views: indices of training views that are not learned from, to stop early.
            extent: of the scene, in world units.
            backend: where steps are calculated.
            objective: what rendered views are compared with; its state is a part of the training's.
            start: the Gaussians before the first step.
        """
        self.config, self.seed, self.cameras, self.extent = config, seed, cameras, extent
        self.validation_views = validation_views
        self.learned = tuple(view for view in range(len(cameras)) if view not in validation_views)
        self.backend, self.objective = backend, objective
        self.iterations, self.iteration, self.seconds = config.iterations, 0, 0.0
        self._put(fresh_state(start))

    @property
    def state(self) -> TrainingState:
        """What the steps have led to; valid until the next one."""
        return self.backend.get(self.iteration, self.seconds)

    @property
    def finished(self) -> bool:
        """Whether all steps are done, or the validation views have not been matched better for too many validations."""
        if self.iteration >= self.iterations:
            return True
        early_stop, residuals = self.config.early_stop, self._placed.residuals
        if early_stop is None or not residuals:
            return False
        return len(residuals) - 1 - int(np.argmin(residuals)) >= early_stop.patience

    def step(self) -> Metrics:
        """Learn from one view, and do what is due between two steps."""
        loss = self._learn()
        self.iteration += 1
        if self._change_due():
            self._change()
        return {"loss": loss, "Gaussians": len(self._placed.gaussians)}

    def state_dict(self) -> Tree:
        """The training state, and what the objective has learned."""
        return {**state_to_tree(self.state), "objective": self.objective.state_dict()}

    def load_state_dict(self, tree: Tree) -> None:
        """Take over what `state_dict` gave."""
        state = state_from_tree(tree)
        self.objective.load_state_dict(tree["objective"])
        self.iteration, self.seconds = state.iteration, state.seconds
        self._put(state)

    def _put(self, state: TrainingState) -> None:
        """Hand a state to the backend; until the next, residuals and the number of Gaussians stay as they are."""
        self._placed = state
        self.backend.put(state)

    def _learn(self) -> float:
        """One view; returns its loss."""
        config, iteration = self.config, self.iteration
        view = self.learned[schedule.view_at(iteration, len(self.learned), self.seed)]
        shrink = schedule.shrink_at(iteration, config.iterations, config.resolutions)
        degree = schedule.sh_degree_at(iteration, config.sh_degree_interval, config.sh_degree)
        rates = schedule.rates_at(iteration, config.iterations, config.learning_rates, self.extent, config.sh_degree)
        if self.objective.appearance is not None:
            rates |= {FEATURES: self.objective.appearance.feature_rate(iteration)}
        step_options = config.strategy.step_options(iteration, float(rates["means"]), self.extent, self.seed)
        camera = schedule.shrunk(self.cameras[view], shrink)
        self._show(view, iteration)
        return self.backend.step(camera, view, iteration, degree, rates, step_options)

    def _show(self, view: int, iteration: int) -> None:
        """Show the objective the Gaussians, if it wants to see them."""
        if self.objective.wants_gaussians(view, iteration):
            self.objective.see(self.backend.gaussians(), view, iteration)

    def _change_due(self) -> bool:
        """Whether `_change` has anything to do after so many steps."""
        config, done = self.config, self.iteration
        checked = done % CHECK_EVERY == 0 or done == config.iterations
        pruned = config.pruning is not None and config.pruning.due(done - 1, config.iterations)
        refined = config.strategy.due(done - 1)
        return refined or pruned or self._validation_due() or (checked and self.backend.non_finite() > 0)

    def _validation_due(self) -> bool:
        """Whether the validation views are compared after so many steps."""
        return self.config.early_stop is not None and self.iteration % self.config.early_stop.every == 0

    def _change(self) -> None:
        """Remove Gaussians that are not finite, refine, prune, validate: what of it is due."""
        config, done = self.config, self.iteration
        state = without_non_finite(self.state)
        if config.strategy.due(done - 1):
            state = config.strategy.refine(state, self.extent, self.seed)
        self._put(state)
        if config.pruning and config.pruning.due(done - 1, config.iterations):
            left = config.pruning.left(done - 1, config.iterations)
            self._put(prune(state, self.backend.contributions(self.cameras), config.pruning, left))
        if self._validation_due():
            degree = schedule.sh_degree_at(done - 1, config.sh_degree_interval, config.sh_degree)
            for view in self.validation_views:
                self._show(view, done)
            losses = [self.backend.residual(self.cameras[view], view, degree) for view in self.validation_views]
            self._put(replace(self._placed, residuals=(*self._placed.residuals, float(np.mean(losses)))))
