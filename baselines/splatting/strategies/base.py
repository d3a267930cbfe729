"""How many Gaussians, and where: what the training loop asks a strategy, whichever it is.

`DefaultStrategy` (Kerbl et al. 2023) clones, splits, prunes and resets opacities; `MCMCStrategy` (Kheradmand et al.
2024) moves dead Gaussians to live ones within a budget. The type of `TrainerConfig.strategy` chooses.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from baselines.splatting.state import TrainingState


@dataclass(frozen=True)
class PositionNoise:
    """Noise that is added to positions after a step."""

    factor: float  # in 1 / world units: it is multiplied by covariances
    generator: np.random.Generator


@dataclass(frozen=True)
class StepOptions:
    """What a strategy asks of one step, beside learning from the view."""

    watch: bool = False  # add up position gradients in the state
    absolute: bool = False  # with absolute values summed over pixels (Ye et al. 2024, AbsGS)
    opacity_penalty: float = 0.0  # weight of the mean opacity in the loss
    scale_penalty: float = 0.0  # factor of the mean standard deviation in the loss, in 1 / world units
    noise: PositionNoise | None = None


@dataclass(frozen=True, kw_only=True)
class Refinement:
    """When strategies add and remove Gaussians; the defaults are those of Kerbl et al. 2023 and of 3DGS-MCMC."""

    start: int = 500  # first iteration with a refinement
    every: int = 100  # iterations between two refinements


def refinement_due(iteration: int, start: int, stop: int, every: int) -> bool:
    """Whether step `iteration` ends a round of `every` steps, from `start` steps on and before `stop`."""
    done = iteration + 1
    return start <= done < stop and done % every == 0


class Strategy(Protocol):
    """A frozen dataclass of settings with three hooks; iterations count from 0."""

    def step_options(self, iteration: int, means_lr: float, extent: float, seed: int) -> StepOptions:
        """What to do in a step.

        Args:
            iteration: of the step.
            means_lr: learning rate of the positions in it, in world units.
            extent: of the scene, in world units.
            seed: of the training.
        """

    def due(self, iteration: int) -> bool:
        """Whether to refine after step `iteration`."""

    def refine(self, state: TrainingState, extent: float, seed: int) -> TrainingState:
        """A new state, with Gaussians added, moved and removed, after the state's last step.

        All parameters are finite: what is not has been taken out before.
        """
