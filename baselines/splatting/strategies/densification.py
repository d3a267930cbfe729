"""Adaptive density control (Kerbl et al. 2023, section 5): grow where the image gradient asks for it, up to a budget.

Large Gaussians are split and small ones cloned; transparent ones are removed, opacities reset now and then.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from baselines.splatting.gaussians import Gaussians, join
from baselines.splatting.kernels.splats.position_gradients import add_position_gradients
from baselines.splatting.schedule import Stream, random_stream
from baselines.splatting.state import TrainingState
from baselines.splatting.strategies.base import Refinement, StepOptions, refinement_due
from hydroviews.scene.quaternions import rotation_matrices

SPLIT_INTO = 2
RESET_TO = 0.01  # highest opacity after a reset (Kerbl et al. 2023)
SHRINK = 1.6  # a split Gaussian's parts are smaller by this factor


@dataclass(frozen=True)
class DefaultStrategy(Refinement):
    """When and where to grow. Iterations count from 0; lengths are shares of the scene extent.

    The default numbers are those of Kerbl et al. 2023 (section 5.2); this is what differs from their code.

    * The first refinement comes after `start` steps; theirs one round later, at 600.
    * Gaussians above `prune_scale3d` go from the first refinement on; theirs after the first opacity reset, together
      with those wider than 20 pixels on the image, which stay here.
    * What is removed is found before growing, so new Gaussians stay for a round; theirs is found afterwards.
    * `budget` and `growth` bound the number: those with the largest gradients grow first.

    Raises:
        ValueError: opacities that are reset to what is removed.
    """

    stop: int = 15_000  # iteration from which there is no refinement
    budget: int = 5_000_000  # largest number of Gaussians
    growth: float = 10.0  # largest share of the present number that one refinement adds
    grow_grad2d: float = 2e-4  # mean gradient by the normalised image position above which a Gaussian is too coarse
    absolute: bool = False  # sum absolute gradients over pixels, which finds blurred texture (Ye et al. 2024, AbsGS)
    grow_scale3d: float = 0.01  # scale threshold: larger Gaussians are split, smaller ones are cloned
    prune_opacity: float = 0.005  # Gaussians with a smaller opacity are removed
    prune_scale3d: float = 0.1  # Gaussians with a larger scale are removed
    reset_every: int | None = 3000  # iterations between two opacity resets; None for never

    def __post_init__(self) -> None:
        if self.reset_every is not None and self.prune_opacity >= RESET_TO:
            raise ValueError(f"a reset to {RESET_TO} would remove every Gaussian: prune_opacity must be smaller")

    def step_options(self, iteration: int, means_lr: float, extent: float, seed: int) -> StepOptions:
        """See Strategy: gradients are added up while Gaussians may still be added."""
        return StepOptions(watch=iteration + 1 < self.stop, absolute=self.absolute)

    def due(self, iteration: int) -> bool:
        """See Strategy."""
        return grow_due(self, iteration) or reset_due(self, iteration)

    def refine(self, state: TrainingState, extent: float, seed: int) -> TrainingState:
        """See Strategy: add and remove, reset opacities, or both."""
        iteration = state.iteration - 1
        if grow_due(self, iteration):
            state = grow(state, self, extent, random_stream(seed, Stream.SPLITTING, iteration))
        return reset_opacity(state, self) if reset_due(self, iteration) else state


def observe(
    state: TrainingState, visible: NDArray[np.bool_], means2d: NDArray[np.float32], size: tuple[int, int]
) -> None:
    """Add one view's position gradients, in place.

    Args:
        state: being trained.
        visible: [N], which Gaussians the view shows.
        means2d: dloss/d(position on the image in pixels) [N, 2].
        size: width and height of the image; gradients are by position in units of half of it, as in the paper.
    """
    half_width, half_height = np.float32(size[0] / 2), np.float32(size[1] / 2)
    add_position_gradients(visible, means2d, half_width, half_height, state.gradient_sum, state.seen)


def grow_due(strategy: DefaultStrategy, iteration: int) -> bool:
    """Whether to add and remove after step `iteration`."""
    return refinement_due(iteration, strategy.start, strategy.stop, strategy.every)


def reset_due(strategy: DefaultStrategy, iteration: int) -> bool:
    """Whether to reset opacities after step `iteration`; never once growth has stopped."""
    done = iteration + 1
    return strategy.reset_every is not None and done < strategy.stop and done % strategy.reset_every == 0


def grow(
    state: TrainingState, strategy: DefaultStrategy, extent: float, generator: np.random.Generator
) -> TrainingState:
    """Remove what is transparent or oversized; split or clone those with the largest gradients.

    Args:
        state: trained so far.
        strategy: the settings.
        extent: of the scene, in world units.
        generator: for the positions of split Gaussians.

    Returns:
        A new state with its statistics at zero; new Gaussians start with zero moments.
    """
    gaussians = state.gaussians
    size = np.exp(gaussians.log_scales).max(axis=1)
    opacity = 1 / (1 + np.exp(-gaussians.opacity_logits))
    keep = (opacity >= strategy.prune_opacity) & (size <= strategy.prune_scale3d * extent)
    gradient = np.where(keep, state.gradient_sum / np.maximum(state.seen, 1), 0)

    kept = int(keep.sum())
    room = max(0, min(strategy.budget - kept, int(strategy.growth * kept)))
    chosen = np.flatnonzero(gradient > strategy.grow_grad2d)
    chosen = chosen[np.argsort(-gradient[chosen], kind="stable")[:room]]
    large = size[chosen] > strategy.grow_scale3d * extent
    cloned, split = np.sort(chosen[~large]), np.sort(chosen[large])
    keep[split] = False
    added = join(gaussians, cloned, split_up(gaussians.select(split), generator))
    return state.refined(keep, added)


def split_up(gaussians: Gaussians, generator: np.random.Generator) -> Gaussians:
    """Two smaller Gaussians for each, at positions drawn from it."""
    parts = gaussians.map(lambda value: np.concatenate([value] * SPLIT_INTO))
    moved = parts.means + offsets(parts, generator)
    shrunk = parts.log_scales - np.float32(np.log(SHRINK))
    return replace(parts, means=moved.astype(np.float32), log_scales=shrunk)


def offsets(gaussians: Gaussians, generator: np.random.Generator) -> NDArray[np.float64]:
    """A random vector [N, 3] from each Gaussian's own normal distribution, in world units."""
    along_axes = generator.standard_normal((len(gaussians), 3)) * np.exp(gaussians.log_scales.astype(np.float64))
    return np.asarray(np.einsum("nij,nj->ni", rotation_matrices(gaussians.quaternions), along_axes))


def reset_opacity(state: TrainingState, strategy: DefaultStrategy) -> TrainingState:
    """Make everything nearly transparent, so that only what the views ask for comes back; clears those moments."""
    ceiling = np.float32(np.log(RESET_TO / (1 - RESET_TO)))
    lowered = np.minimum(state.gaussians.opacity_logits, ceiling)
    none = np.zeros_like(lowered)
    return replace(
        state,
        gaussians=replace(state.gaussians, opacity_logits=lowered),
        first=replace(state.first, opacity_logits=none),
        second=replace(state.second, opacity_logits=none.copy()),
    )
