"""How to train a splatted scene."""

from dataclasses import dataclass, field

from baselines.splatting.schedule import LearningRates
from baselines.splatting.strategies.densification import DefaultStrategy
from baselines.splatting.strategies.pruning import Pruning
from baselines.splatting.strategies.relocation import MCMCStrategy


@dataclass(frozen=True)
class EarlyStop:
    """When to stop before all iterations are done: a few training views validate, and nothing is learned from them."""

    views: int = 3  # that validate, spread evenly over the training views
    every: int = 500  # iterations between two validations
    patience: int = 4  # validations in a row without a smaller loss after which training stops


@dataclass(frozen=True)
class TrainerConfig:
    """How to train. The default numbers are those of Kerbl et al. 2023; this is what differs from their code.

    * `near` is a hundredth of the scene's extent; theirs is 0.2 world units, whatever these are.
    * The extent leaves out cameras that lie far from all others, and comes of the points where cameras stand in one
      place (`initialisation.scene_extent`).
    * No Gaussian starts larger than a twentieth of the extent; fewer than 100 scene points are filled up with 10,000
      random ones (`initialisation.initialise`).
    * The spherical-harmonic degree rises one step later, and the positions' rate falls from the first step on: steps
      count from 0, theirs from 1.
    * Points that coincide start as Gaussians of 1e-7 of the extent; theirs of 3e-4 world units.
    * A Gaussian at the largest opacity that a pixel takes has no gradient there, as in gsplat.
    * Whatever `DefaultStrategy` lists.

    Lengths and iterations are in the units that each comment names; a training's own images set its resolution.

    Raises:
        ValueError: shares of `resolutions` that add up to more than 1, or factors below 1; a share of the budget that
            is none.
    """

    iterations: int = 30_000
    sh_degree: int = 3
    sh_degree_interval: int = 1000  # iterations between two rises of the spherical-harmonic degree
    lambda_dssim: float = 0.2  # lambda in (1 - lambda) L1 + lambda (1 - SSIM)
    learning_rates: LearningRates = field(default_factory=LearningRates)
    strategy: DefaultStrategy | MCMCStrategy = field(default_factory=DefaultStrategy)
    resolutions: tuple[tuple[float, int], ...] = ()  # (share of the iterations, factor by which images are smaller)
    early_stop: EarlyStop | None = None
    pruning: Pruning | None = None
    dense_start: float = 0.0  # share of the strategy's budget to start with, between the points if these are fewer
    background: tuple[float, float, float] = (0.0, 0.0, 0.0)
    antialiased: bool = False  # Gaussians smaller than a pixel become fainter as they are widened to it
    near: float = 0.01  # nothing nearer to a camera is shown; a share of the scene extent
    device: str = "auto"  # auto, cpu or cuda; $HYDROVIEWS_DEVICE comes first
    checkpoint_seconds: float = 30.0  # of training between two checkpoints

    def __post_init__(self) -> None:
        shares, factors = [share for share, _ in self.resolutions], [factor for _, factor in self.resolutions]
        if any(not 0 < share <= 1 for share in shares) or sum(shares) > 1 or any(factor < 1 for factor in factors):
            raise ValueError(
                f"resolutions {self.resolutions}: expected shares that add up to at most 1, factors from 1"
            )
        if not 0 <= self.dense_start <= 1:
            raise ValueError(f"dense_start {self.dense_start}: expected a share of the budget, from 0 to 1")
