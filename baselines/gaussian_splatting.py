"""3D Gaussian splatting (Kerbl et al. 2023), trained on the rainy views and, as the ceiling, on the clean ones.

With adaptive density control, as the benchmark's reference rows have it, or with half the Gaussians.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np

from baselines.clean_wrapper import on_clean
from baselines.method import Method, TrainingSummary, settings_of
from baselines.splatting.config import Pruning
from baselines.splatting.files.checkpoints import read_model, write_model
from baselines.splatting.files.ply import SPLATS, write_ply
from baselines.splatting.gaussians import Gaussians
from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.kernels.photometric import Plane
from baselines.splatting.kernels.rasterizer import render
from baselines.splatting.objective import Objective
from baselines.splatting.schedule import LearningRates
from baselines.splatting.strategies.densification import DefaultStrategy
from baselines.splatting.strategies.relocation import MCMCStrategy
from baselines.splatting.trainer import TrainedScene, TrainerConfig, train
from hydroviews.errors import InputError
from hydroviews.files.atomic import read_json, write_json
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import Image
from hydroviews.scene.scenes import Scene

MODEL = "model.safetensors"
FOUND = "found.json"  # where methods look for more than the scene in their photographs
# Of a training, in the model.
RECORDED = ("near", "seconds", "device", "extent", "iterations", "residuals", "non_finite")

# Short runs: large steps that cool down at the end, the first third at half the size, no opacity resets, fast growth by
# absolute gradients up to a budget that two cores can afford; what is nearly transparent makes room. Growth alone takes
# too many of the steps of `demo` where a capture has few points.
# Chosen on clean views of courtyard, LLFF flower and Mip-NeRF 360 bonsai: docs/experiments/2026-11-faster-training.md
# has what was tried.
SHORT_RATES = LearningRates(
    means=5e-4,
    means_final=1e-5,
    sh=1.5e-2,
    sh_rest=7.5e-4,
    opacity=0.2,
    scales=2e-2,
    quaternions=8e-3,
    final=0.6,
    cooldown=0.15,
    cooled=0.1,
)
GROWTH = DefaultStrategy(growth=0.3, grow_grad2d=2e-4, absolute=True, reset_every=None, prune_scale3d=0.5)
SHORT = TrainerConfig(
    iterations=1600,
    sh_degree_interval=270,
    learning_rates=SHORT_RATES,
    near=0.05,
    strategy=replace(GROWTH, start=150, stop=1200, every=50, budget=30_000, prune_opacity=0.02),
    resolutions=((0.3, 2),),
)
PROFILES = {
    "demo": replace(SHORT, dense_start=0.5),
    "quick": replace(
        SHORT,
        iterations=7500,
        sh_degree_interval=750,
        learning_rates=replace(SHORT_RATES, sh=1.125e-2, sh_rest=5.625e-4, opacity=0.15, quaternions=6e-3, final=0.3),
        strategy=replace(GROWTH, start=200, stop=5400, every=100, budget=60_000, prune_opacity=0.015),
    ),
    "paper": TrainerConfig(),
}
# For methods that train networks of their own, which want more lessons: with the steps above gs-w loses 0.5 dB.
WITH_NETWORKS = TrainerConfig(
    iterations=3000,
    sh_degree_interval=500,
    learning_rates=LearningRates(sh=7.5e-3, sh_rest=3.75e-4, opacity=0.1, scales=2e-2, quaternions=4e-3, final=0.1),
    near=0.05,
    strategy=replace(GROWTH, start=300, stop=2200, every=100, budget=30_000),
)
PROFILES_WITH_NETWORKS = {
    "demo": WITH_NETWORKS,
    "quick": replace(
        WITH_NETWORKS,
        iterations=8000,
        sh_degree_interval=667,
        strategy=replace(WITH_NETWORKS.strategy, stop=6000, budget=60_000),
    ),
}


def with_iterations(iterations: int, profile: TrainerConfig) -> TrainerConfig:
    """A profile's training in another number of iterations, growing for the same share of them.

    For methods whose steps cost more, so that they stay within the same time.
    """
    strategy, share = profile.strategy, iterations / profile.iterations
    return replace(
        profile,
        iterations=iterations,
        sh_degree_interval=round(share * profile.sh_degree_interval),
        strategy=replace(strategy, stop=round(share * strategy.stop)),
    )


def pruned_to_budget(budget: int, profile: TrainerConfig) -> TrainerConfig:
    """A profile's training with fewer Gaussians: half as many again grow early, the least useful go before the middle.

    Twice the iterations, most of them with the Gaussians that stay, whose steps are cheaper. On so small a budget that
    beats relocation, which wants more iterations than short profiles have: docs/experiments/2026-11-splatting.md has
    the figures.
    """
    iterations = 2 * profile.iterations
    return replace(
        profile,
        iterations=iterations,
        strategy=replace(profile.strategy, stop=round(0.24 * iterations), budget=3 * budget // 2),
        pruning=Pruning(at=(0.25, 0.35, 0.45), budget=budget),
    )


BUDGETED = {
    "demo": pruned_to_budget(15_000, PROFILES["demo"]),
    "quick": pruned_to_budget(30_000, PROFILES["quick"]),
    "paper": replace(PROFILES["paper"], strategy=MCMCStrategy()),
}


class GaussianSplatting(Method):
    """3DGS (Kerbl et al. 2023), plain: takes rain for part of the scene."""

    profiles: ClassVar[Mapping[str, Any]] = PROFILES

    def __init__(self, config: Any, seed: int) -> None:
        super().__init__(config, seed)
        self.found: dict[str, Any] = {}  # in the photographs, beside the scene
        self._objective: Objective | None = None  # after `fit`
        self._trained: TrainedScene | None = None
        self._model_mb: float | None = None
        self._buffers = BufferPool()

    @classmethod
    def configuration(cls, profile: str) -> Any:
        """See Method.

        Raises:
            InputError: no such profile.
        """
        return settings_of(profile, cls.profiles)

    def fit(self, scene: Scene, folder: Path) -> None:
        """See Method."""
        self._objective = self.objective(scene, folder)
        self._trained = train(scene, self.splatting, self.seed, folder, self._objective)
        if self._objective is not None:
            self.found |= self._objective.report()

    def hidden(self, view: int, size: tuple[int, int]) -> Plane | None:
        """See Method."""
        return None if self._objective is None else self._objective.hidden(view, size)

    @property
    def splatting(self) -> TrainerConfig:
        """How the Gaussians are trained: the part of the settings of this name, or all there are."""
        config: TrainerConfig = self.config if isinstance(self.config, TrainerConfig) else self.config.splatting
        return config

    def objective(self, scene: Scene, folder: Path) -> Objective | None:
        """What renders are compared with in `fit`, where it is not the photographs; `folder` may keep what it needs.

        What it finds beside the scene it says itself, by `report` and `hidden`.
        """
        return None

    def render(self, camera: Camera) -> Image:
        """See Method; always with our own kernels, so that pixels do not depend on where a model was trained."""
        trained = self._require()
        background = np.asarray(self.splatting.background, np.float32)
        image, _ = render(
            self.gaussians_for_camera(camera),
            camera,
            background,
            near=trained.near,
            antialiased=self.splatting.antialiased,
            buffers=self._buffers,
        )
        return np.clip(image, 0, 1)

    def gaussians_for_camera(self, camera: Camera) -> Gaussians:
        """The Gaussians in the colours that a camera is shown; here all cameras are shown the same."""
        return self._require().gaussians

    def export_gaussians(self) -> Gaussians:
        """The Gaussians as a .ply can hold them."""
        return self._require().gaussians

    def save(self, folder: Path) -> None:
        """Write the exact model, a .ply for viewers, and what was found beside the scene."""
        trained = self._require()
        about = {name: getattr(trained, name) for name in RECORDED} | {"found": bool(self.found)}
        write_model(folder / MODEL, trained.gaussians, about)
        write_ply(folder / SPLATS, self.export_gaussians())
        if self.found:
            write_json(folder / FOUND, self.found)
        self._model_mb = (folder / MODEL).stat().st_size / 1e6

    @classmethod
    def load(cls, config: Any, seed: int, folder: Path) -> Self:
        """See Method.

        Raises:
            InputError: the model, or what was found beside it, is missing or damaged.
        """
        gaussians, about = read_model(folder / MODEL)
        method = cls(config, seed)
        if about.pop("found", False):
            method.found = read_json(folder / FOUND)
        about["residuals"] = tuple(about.get("residuals", ()))
        method._trained = TrainedScene(gaussians=gaussians, compile_seconds=0.0, **about)
        method._model_mb = (folder / MODEL).stat().st_size / 1e6
        return method

    def summary(self) -> TrainingSummary:
        """See Method; `used` lists what was found in the photographs."""
        trained = self._require()
        texts = {name: " and ".join(v) or "nothing" if isinstance(v, list) else v for name, v in self.found.items()}
        used = ", ".join(f"{name} {text}" for name, text in texts.items())
        return TrainingSummary(trained.seconds, len(trained.gaussians), self._model_mb, trained.device, used, "cpu")

    def _require(self) -> TrainedScene:
        if self._trained is None:
            raise InputError(f"{type(self).__name__}: not trained", fix="call fit or load first")
        return self._trained


class BudgetedSplatting(GaussianSplatting):
    """Plain 3DGS with half the Gaussians: pruned by contribution, or at full size by relocation (3DGS-MCMC)."""

    profiles: ClassVar[Mapping[str, Any]] = BUDGETED


# The references of every table; other methods are shown the clean views by `NAME+clean`.
GaussianSplattingClean, BudgetedSplattingClean = on_clean(GaussianSplatting), on_clean(BudgetedSplatting)
