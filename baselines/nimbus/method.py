"""NimbusGS (2026): a scene behind a medium in space, and behind what is each view's own.

The public code lacks its training and its rain; what the paper does not say is ours. Departures:
  - Whether there is a medium is tried first (`trial.py`).
  - A view's depth is rendered in small, now and then, and rays are cast through a smaller picture.
  - Densification is plain splatting's, not weighed by depth, size and error; lambda of SSIM is plain splatting's.
  - The medium begins as nearly clear air, in units of the scene.
"""

import logging
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import torch

from baselines.distractors.method import SPLATTING, DistractorMethod
from baselines.nimbus.config import MediumConfig, NimbusConfig, ResidualConfig
from baselines.nimbus.medium import Medium
from baselines.nimbus.objective import NimbusObjective
from baselines.nimbus.trial import hold_trial
from baselines.nimbus.view_rays import box_around
from baselines.splatting.backends.base import GSPLAT
from baselines.splatting.initialisation import scene_extent
from baselines.splatting.trainer import train
from baselines.training.devices import chosen_device
from baselines.training.images import TrainingImages, read_images
from hydroviews.scene.scenes import Scene

logger = logging.getLogger(__name__)
TRIAL = "trial"  # folder of the short trainings

SHORT_MEDIUM = MediumConfig(cells=48, rate=0.02, renewed=100, dark=0.1)
SHORT_RESIDUAL = ResidualConfig()


class Nimbus(DistractorMethod):
    """NimbusGS (2026): a medium in space where one is found, and a residual of each view."""

    profiles: ClassVar[Mapping[str, Any]] = {
        "demo": NimbusConfig(SPLATTING["demo"], SHORT_MEDIUM, SHORT_RESIDUAL),
        "quick": NimbusConfig(SPLATTING["quick"], replace(SHORT_MEDIUM, cells=64, renewed=200), SHORT_RESIDUAL),
        "paper": NimbusConfig(SPLATTING["paper"]),
    }

    def fit(self, scene: Scene, folder: Path) -> None:
        """See Method; a trial says whether there is a medium."""
        images, medium = read_images(scene.train_views), self.config.medium
        with_medium, spent = medium.used, 0.0
        if medium.used and medium.trial:
            with_medium, spent = self._tried(scene, images, folder)
        self._objective = objective = self._objective_of(scene, images, self.config, with_medium)
        trained = train(scene, self.splatting, self.seed, folder, objective)
        self._trained = replace(trained, seconds=trained.seconds + spent)
        self.found |= objective.report()

    def objective(self, scene: Scene, folder: Path) -> NimbusObjective:
        """See GaussianSplatting; with a medium where settings have one, and no trial."""
        return self._objective_of(scene, read_images(scene.train_views), self.config, self.config.medium.used)

    def _tried(self, scene: Scene, images: TrainingImages, folder: Path) -> tuple[bool, float]:
        """Whether a medium is kept, and the seconds it took to know."""

        def objectives(config: NimbusConfig, used: bool) -> NimbusObjective:
            return self._objective_of(scene, images, config, used)

        trial = hold_trial(scene, self.config, self.seed, folder / TRIAL, objectives)
        if trial is None:
            return False, 0.0
        kept = trial.kept(self.config.medium.margin)
        losses = f"loss of held-back views {trial.with_medium:.4f} with it, {trial.without:.4f} without"
        logger.info("nimbus: medium %s, %s", "kept" if kept else "left out", losses)
        self.found["trial"] = losses
        return kept, trial.seconds

    def _objective_of(
        self, scene: Scene, images: TrainingImages, config: NimbusConfig, with_medium: bool
    ) -> NimbusObjective:
        cameras = [view.camera for view in scene.train_views]
        near = config.splatting.near * scene_extent(cameras)[1]
        medium = None
        if with_medium:
            box = box_around(scene.points.positions, cameras, config.medium.box)
            device = torch.device(chosen_device(config.splatting.device, GSPLAT))
            medium = Medium(config.medium, box, self.seed).to(device)
        return NimbusObjective(images, cameras, config, medium, near)
