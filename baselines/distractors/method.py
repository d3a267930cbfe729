"""What the methods of this folder have in common: splatting with an objective that reports what it found."""

from abc import abstractmethod
from dataclasses import replace
from pathlib import Path

from baselines.gaussian_splatting import PROFILES, GaussianSplatting
from baselines.method import TrainingSummary
from baselines.splatting.config import TrainerConfig
from baselines.splatting.kernels.photometric import Plane
from baselines.splatting.objective import Objective
from baselines.splatting.strategies.densification import DefaultStrategy
from baselines.splatting.trainer import train
from hydroviews.scene.scenes import Scene


class ReportingObjective(Objective):
    """An objective that finds something in the photographs beside the scene."""

    @abstractmethod
    def report(self) -> dict[str, str]:
        """What it found, in words, by name."""

    def hidden(self, view: int, size: tuple[int, int]) -> Plane | None:
        """See Method; None where it does not remember what it left out of a view."""
        return None


def without_resets(splatting: TrainerConfig) -> TrainerConfig:
    """The same training without opacity resets, after which all residuals are large for a while."""
    assert isinstance(splatting.strategy, DefaultStrategy)
    return replace(splatting, strategy=replace(splatting.strategy, reset_every=None))


# Plain splatting's; the authors of these methods reset no opacities.
SPLATTING = {name: without_resets(splatting) for name, splatting in PROFILES.items()}


class DistractorMethod(GaussianSplatting):
    """Splatting whose settings hold those of the Gaussians as `splatting`."""

    _objective: ReportingObjective | None = None  # after `fit`

    @abstractmethod
    def objective(self, scene: Scene, folder: Path) -> ReportingObjective:
        """See GaussianSplatting."""

    def fit(self, scene: Scene, folder: Path) -> None:
        """See Method."""
        self._objective = objective = self.objective(scene, folder)
        self._trained = train(scene, self.splatting, self.seed, folder, objective)
        self.found |= objective.report()

    def hidden(self, view: int, size: tuple[int, int]) -> Plane | None:
        """See Method."""
        return self._objective.hidden(view, size) if self._objective else None

    def summary(self) -> TrainingSummary:
        """See Method; `used` says what was found beside the scene."""
        return replace(super().summary(), used=", ".join(f"{name} {text}" for name, text in self.found.items()))
