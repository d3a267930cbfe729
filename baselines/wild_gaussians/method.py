"""WildGaussians (Kulhanek et al. 2024): splatting for photographs in changing light with things in the way.

Gaussians are toned for each view by an appearance model (`appearance.py`), and pixels that show what is not of
the scene, by frozen features, do not count (`baselines.masking.uncertainty`). The Gaussians are rendered in two sets of
colours a step: the toned image is compared by L1, the plain one by SSIM. Some Gaussians start far off, for the sky
(`sky.py`). Views that were not trained on show each Gaussian as those that were do in the mean (`mean_appearance.py`).

Where it deviates from the paper, beside what those files say: the densification is ours, by absolute gradients as
theirs, without Mip-Splatting's 3D filter; the 2D one is there in the profile `paper`.
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from baselines.encoders.frozen import CALIBRATED, calibrated
from baselines.gaussian_splatting import MASKED, GaussianSplatting
from baselines.masking.uncertainty import Uncertainty, UncertaintyConfig
from baselines.method import Citation, TrainingSummary
from baselines.splatting.backends.base import GSPLAT
from baselines.splatting.config import TrainerConfig
from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.kernels.photometric import photometric_loss
from baselines.splatting.objective import Objective
from baselines.splatting.schedule import LearningRates
from baselines.splatting.strategies.densification import DefaultStrategy
from baselines.splatting.strategies.initialisation import scene_extent
from baselines.splatting.trainer import train
from baselines.splatting_profiles import PROFILES_WITH_NETWORKS
from baselines.training.checkpoints import settings_of
from baselines.training.devices import chosen_device
from baselines.training.images import TrainingImages, read_images
from baselines.training.torch_state import one_thread
from baselines.wild_gaussians.appearance import AppearanceConfig, WildAppearance
from baselines.wild_gaussians.mean_appearance import mean_appearance
from baselines.wild_gaussians.sky import bounds_of, with_room, with_sky
from hydroviews.errors import InputError
from hydroviews.scene.images import Image
from hydroviews.scene.scenes import Scene

FEATURES = "HYDROVIEWS_FEATURES"  # environment variable: the uncertainty's network in place of the profile's


@dataclass(frozen=True)
class WildConfig:
    """Splatting, and what is added to it; None or 0 leaves a part out."""

    splatting: TrainerConfig
    appearance: AppearanceConfig | None = field(default_factory=AppearanceConfig)
    uncertainty: UncertaintyConfig | None = field(default_factory=UncertaintyConfig)
    sky: int = 0  # number of points on the sky's sphere; points within a view become Gaussians


def short(plain: TrainerConfig) -> WildConfig:
    """A profile of plain splatting with larger steps, a smaller network for the appearance, and no sky.

    The uncertainty has a thousandth of the lessons it has in the paper. It starts where pixels just count, since where
    it starts is where most of it still is after a few hundred. And its floor is there too: the loss grows with d / u^2,
    so that with u down to 0.1 few positions decide how far Adam goes in all. docs/methods/splatting.md has figures.
    """
    lesson, start, warm_up = (round(share * plain.iterations) for share in (0.13, 0.4, 0.1))
    return WildConfig(
        plain,
        AppearanceConfig(width=32, scale=0.1, rate=2e-3, view_rate=5e-3, gaussian_rate=5e-3, final=0.1),
        UncertaintyConfig(
            "alexnet", start, warm_up, protected=0, first_lesson=lesson, every=2, rate=5e-3, prior=0.6, least=0.5
        ),
    )


# The authors' schedule for casual captures: 70,000 iterations, slow rates, growth by absolute gradients.
PAPER = TrainerConfig(
    iterations=70_000,
    learning_rates=LearningRates(means=1.6e-5, means_final=1.6e-7, scales=5e-4),
    strategy=DefaultStrategy(start=1800, stop=35_000, every=1500, absolute=True, reset_every=5000),
    antialiased=True,
)
PROFILES = {
    **{name: short(splatting) for name, splatting in PROFILES_WITH_NETWORKS.items()},
    "paper": WildConfig(PAPER, sky=50_000),
}


class WildObjective(Objective):
    """L1 of the toned image and SSIM of the plain one, over the pixels that are taken for the scene's."""

    def compare(
        self, images: Sequence[Image], view: int, iteration: int, buffers: BufferPool
    ) -> tuple[float, Sequence[Image]]:
        """See Objective."""
        toned, plain = images
        size = toned.shape[0], toned.shape[1]
        weights = self.weights(lambda: toned, view, size, iteration, buffers)
        target = self.target(view, size)
        total, gradients = 0.0, []
        for image, lambda_dssim, share in ((toned, 0.0, 1 - self.lambda_dssim), (plain, 1.0, self.lambda_dssim)):
            loss, gradient = photometric_loss(image, target, lambda_dssim, weights, buffers)
            total += share * loss
            gradients.append(np.float32(share) * gradient)  # a copy: the next call writes over it
        return total, gradients


class WildGaussians(GaussianSplatting):
    """WildGaussians (Kulhanek et al. 2024): splatting with appearance, uncertainty and sky.

    The trained model has the mean appearance: ordinary Gaussians.
    """

    citation = Citation(
        title="WildGaussians",
        paper="WildGaussians: 3D Gaussian Splatting in the Wild",
        authors="J. Kulhanek, S. Peng, Z. Kukelova, M. Pollefeys, T. Sattler",
        year=2024,
        link="https://arxiv.org/abs/2407.08447",
        code="https://github.com/jkulhanek/wild-gaussians",
        licence="MIT; its renderer: Gaussian-Splatting License (research and evaluation only)",
    )

    profiles: ClassVar[Mapping[str, Any]] = PROFILES

    @classmethod
    def configuration(cls, profile: str) -> Any:
        """See Method; $HYDROVIEWS_FEATURES, where it is set, becomes a setting as any other.

        Raises:
            InputError: no such profile, or no such network.
        """
        config: WildConfig = super().configuration(profile)
        named = os.environ.get(FEATURES)
        if not named or not config.uncertainty:
            return config
        network = next((known for known in CALIBRATED if known == named), None)
        if network is None:
            raise InputError(f"{FEATURES}={named}: unknown", expected=" or ".join(CALIBRATED))
        return replace(config, uncertainty=replace(config.uncertainty, features=network))

    def fit(self, scene: Scene, folder: Path) -> None:
        """See Method."""
        config: WildConfig = self.config
        bounds, before = bounds_of(scene), len(scene.points)
        scene = with_sky(scene, bounds, config.sky)
        extent = scene_extent([view.camera for view in scene.train_views], scene.points.positions)[1]
        splatting = with_room(config.splatting, bounds, config.sky, extent)
        images, appearance = read_images(scene.train_views), None
        if config.appearance:
            appearance = WildAppearance(len(images), bounds, splatting.iterations, config.appearance, self.seed)
        with one_thread():
            uncertainty = self._uncertainty(images)
            objective = WildObjective(images, splatting.lambda_dssim, appearance, uncertainty)
            settings = settings_of(config, method=type(self).__name__)
            trained = train(scene, splatting, self.seed, folder, objective, settings)
            if appearance:
                cameras = [view.camera for view in scene.train_views]
                shown = mean_appearance(trained.gaussians, appearance, cameras, trained.near, splatting.antialiased)
                trained = replace(trained, gaussians=shown)
        self._trained, self._objective = trained, objective
        self.found |= objective.report() | {"sky": len(scene.points) - before}
        if uncertainty:
            self.note_masked(uncertainty.masked(splatting.iterations))

    def _uncertainty(self, images: TrainingImages) -> Uncertainty | None:
        """Before its first step, if it is wanted."""
        config: WildConfig = self.config
        if not config.uncertainty:
            return None
        features = calibrated(config.uncertainty.features, chosen_device(config.splatting.device, GSPLAT))
        return Uncertainty(images, features, config.uncertainty, config.splatting.strategy, self.seed)

    def summary(self) -> TrainingSummary:
        """See Method; `used` names the uncertainty's features, the share it masks, and how many Gaussians were sky."""
        found = self.found
        parts = [f"uncertainty from {found['uncertainty']}"] if "uncertainty" in found else []
        parts += [f"{found[MASKED]:.1%} of the pixels masked"] if MASKED in found else []
        parts += [f"{found['sky']} Gaussians for the sky"] if found.get("sky") else []
        return replace(super().summary(), used=", ".join(parts))
