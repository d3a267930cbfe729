"""NimbusGS (2026): a scene behind a medium in space, and behind what is each view's own.

The public code lacks its training and its rain; what the paper does not say is ours. Departures:
  - A medium that takes next to no light is given up during the training: clear air, over which scenes become darker.
  - A view's depth is rendered in small, now and then, and rays are cast through a smaller picture.
  - Densification is plain splatting's, not weighed by depth, size and error; lambda of SSIM is plain splatting's.
  - The medium begins as nearly clear air, in units of the scene.
"""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import torch

from baselines.gaussian_splatting import GaussianSplatting
from baselines.method import Citation
from baselines.nimbus.config import MediumConfig, NimbusConfig, ResidualConfig
from baselines.nimbus.medium import Medium
from baselines.nimbus.objective import NimbusObjective
from baselines.nimbus.view_rays import box_around
from baselines.splatting.backends.base import GSPLAT
from baselines.splatting.strategies.initialisation import scene_extent
from baselines.splatting_profiles import PROFILES_WITHOUT_RESETS
from baselines.training.devices import chosen_device
from baselines.training.images import read_images
from hydroviews.scene.cameras import Camera
from hydroviews.scene.scenes import Scene

logger = logging.getLogger(__name__)

# A coarser grid that learns as much in a twentieth of the steps; residuals begin once the detail is learned:
# from where the paper begins on, they cost 4 dB on clean views of courtyard. Chosen on courtyard and LLFF flower,
# docs/experiments/2026-11-nimbus.md.
SHORT_MEDIUM = MediumConfig(cells=48, rate=0.02, renewed=100)
SHORT_RESIDUAL = ResidualConfig(threshold=0.07, first=0.75)


class Nimbus(GaussianSplatting):
    """NimbusGS (2026): a medium in space, if the photographs show one, and a residual per view."""

    citation = Citation(
        title="NimbusGS",
        paper="NimbusGS: Unified 3D Scene Reconstruction under Hybrid Weather",
        authors="Y. Li, J. Li, S. He, Y. Xu, J. Dong, Y. Du",
        year=2026,
        link="https://arxiv.org/abs/2603.27228",
        code="https://github.com/lyy-ovo/NimbusGS",
    )

    profiles: ClassVar[Mapping[str, Any]] = {
        "demo": NimbusConfig(PROFILES_WITHOUT_RESETS["demo"], SHORT_MEDIUM, SHORT_RESIDUAL),
        "standard": NimbusConfig(
            PROFILES_WITHOUT_RESETS["standard"], replace(SHORT_MEDIUM, cells=64, renewed=200), SHORT_RESIDUAL
        ),
        "paper": NimbusConfig(PROFILES_WITHOUT_RESETS["paper"]),
    }

    def objective(self, scene: Scene, folder: Path) -> NimbusObjective:
        """See GaussianSplatting.

        Raises:
            InputError: an unreadable picture, or no such device.
        """
        cameras = [view.camera for view in scene.train_views]
        near = self.splatting.near * scene_extent(cameras, scene.points.positions)[1]
        images = read_images(scene.train_views)
        return NimbusObjective(images, cameras, self.config, self._first_medium(scene, cameras), near)

    def _first_medium(self, scene: Scene, cameras: Sequence[Camera]) -> Medium | None:
        settings: MediumConfig | None = self.config.medium
        if settings is None:
            return None
        if len(cameras) < 2:
            logger.info("nimbus: no medium, because one view cannot separate it from the scene")
            return None
        device = torch.device(chosen_device(self.splatting.device, GSPLAT))
        return Medium(settings, box_around(scene.points.positions, cameras), self.seed).to(device)
