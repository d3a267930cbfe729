"""Settings of the trainer of Gaussians."""

from dataclasses import dataclass, field

from baselines.splatting.schedule import LearningRates
from baselines.splatting.strategies.densification import DefaultStrategy
from baselines.splatting.strategies.pruning import Pruning
from baselines.splatting.strategies.relocation import MCMCStrategy
from baselines.training.config import SessionConfig


@dataclass(frozen=True)
class EarlyStop:
    """When to stop early. A few training views are used for validation only."""

    views: int = 3  # number of validation views, spread evenly over the training views
    every: int = 500  # iterations between two validations
    patience: int = 4  # training stops after this many validations without a smaller loss


@dataclass(frozen=True)
class TrainerConfig(SessionConfig):
    """Settings of a training. Defaults are those of Kerbl et al. 2023. Differences to their code:

    * `near` is a hundredth of the scene's extent; theirs is 0.2 world units.
    * The extent ignores cameras far from all others. If all cameras stand in one place, points give the extent
      (`initialisation.scene_extent`).
    * No Gaussian starts larger than a twentieth of the extent. Fewer than 100 scene points are supplemented by 10,000
      random points (`initialisation.initialise`).
    * Steps count from 0, theirs from 1: the spherical-harmonic degree rises one step later, and the learning rate of
      positions falls from the first step on.
    * Coinciding points start as Gaussians of 1e-7 of the extent; theirs of 3e-4 world units.
    * A Gaussian at the largest opacity of a pixel has no gradient there, as in gsplat.
    * The differences that `DefaultStrategy` lists.

    Comments name the units of lengths and iterations. The images of a training set its resolution.

    Raises:
        ValueError: shares of `resolutions` sum to more than 1, a factor is below 1, or `dense_start` is not in [0, 1].
    """

    iterations: int = 30_000
    sh_degree: int = 3
    sh_degree_interval: int = 1000  # iterations between two rises of the spherical-harmonic degree
    lambda_dssim: float = 0.2  # lambda in (1 - lambda) L1 + lambda (1 - SSIM)
    learning_rates: LearningRates = field(default_factory=LearningRates)
    strategy: DefaultStrategy | MCMCStrategy = field(default_factory=DefaultStrategy)
    resolutions: tuple[tuple[float, int], ...] = ()  # pairs: share of the iterations, factor that shrinks images
    early_stop: EarlyStop | None = None
    pruning: Pruning | None = None
    dense_start: float = 0.0  # share of the strategy's budget at the start; new Gaussians lie between the points
    antialiased: bool = False  # Mip-Splatting's 2D filter: tiny Gaussians are widened and become fainter
    near: float = 0.01  # nearest visible depth, as a share of the scene's extent

    def __post_init__(self) -> None:
        shares, factors = [share for share, _ in self.resolutions], [factor for _, factor in self.resolutions]
        if any(not 0 < share <= 1 for share in shares) or sum(shares) > 1 or any(factor < 1 for factor in factors):
            raise ValueError(
                f"resolutions {self.resolutions}: expected shares that add up to at most 1, factors from 1"
            )
        if not 0 <= self.dense_start <= 1:
            raise ValueError(f"dense_start {self.dense_start}: expected a share of the budget, from 0 to 1")
