"""How to train a splatted scene."""

from dataclasses import dataclass, field

from baselines.splatting.densification import Densification
from baselines.splatting.relocation import Relocation
from baselines.splatting.schedule import LearningRates


@dataclass(frozen=True)
class EarlyStop:
    """When to stop before all iterations are done: a few training views are held in, not learnt from but looked at."""

    views: int = 3  # held in, spread evenly over the training views
    every: int = 500  # iterations between two looks
    patience: int = 4  # looks in a row without a smaller loss after which training stops


@dataclass(frozen=True)
class Pruning:
    """Removal of the Gaussians that contribute least to the training views, by their blending weights alpha T."""

    at: tuple[float, ...] = (0.8,)  # when, in shares of the iterations
    share: float = 0.0  # this share of the Gaussians is removed, those with the smallest sum of weights
    threshold: float = 0.0  # and those whose sum over all pixels of all training views is smaller than this
    budget: int | None = None  # no more are left in the end: every moment takes an equal part of the surplus

    def due(self, iteration: int, iterations: int) -> bool:
        """Whether to prune after step `iteration`."""
        return iteration + 1 in self._moments(iterations)

    def left(self, iteration: int, iterations: int) -> int:
        """How many moments are left after step `iteration`, that one included."""
        return sum(moment > iteration for moment in self._moments(iterations))

    def _moments(self, iterations: int) -> set[int]:
        return {round(share * iterations) for share in self.at}


@dataclass(frozen=True)
class TrainerConfig:
    """How to train; the defaults are those of Kerbl et al. 2023."""

    iterations: int = 30_000
    sh_degree: int = 3
    sh_every: int = 1000  # iterations between two rises of the spherical-harmonic degree
    ssim_share: float = 0.2  # lambda in (1 - lambda) L1 + lambda (1 - SSIM)
    rates: LearningRates = field(default_factory=LearningRates)
    densification: Densification | Relocation = field(default_factory=Densification)
    resolutions: tuple[tuple[float, int], ...] = ()  # (share of the iterations, factor by which images are smaller)
    early_stop: EarlyStop | None = None
    pruning: Pruning | None = None
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
