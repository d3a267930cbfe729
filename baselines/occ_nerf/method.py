"""Occlusion-free NeRF (Zhu et al. 2023)."""

from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, ClassVar

import torch

from baselines.method import TrainingSummary
from baselines.occ_nerf.config import OccNerfConfig
from baselines.occ_nerf.losses import occ_nerf_losses
from baselines.occ_nerf.model import OccNerfModel
from baselines.volumetric.config import NERF, HashFieldConfig, MlpFieldConfig, VolumetricConfig
from baselines.volumetric.losses import Loss
from baselines.volumetric.method import RadianceMethod
from baselines.volumetric.rays import CameraArrays
from baselines.volumetric.spaces import Space
from hydroviews.scene.scenes import Scene

FIELD = HashFieldConfig(rate=2e-2)
SMALL = VolumetricConfig(field=FIELD)
PROFILES = {"demo": OccNerfConfig(replace(SMALL, iterations=5000), FIELD)}


class OccNerf(RadianceMethod):
    """Occlusion-free NeRF (Zhu et al. 2023): the scene behind what stands far before it."""

    profiles: ClassVar[Mapping[str, Any]] = PROFILES

    @property
    def volumetric(self) -> VolumetricConfig:
        """See RadianceMethod."""
        config: OccNerfConfig = self.config
        return config.volumetric

    def make(self, space: Space, generator: torch.Generator, views: int) -> OccNerfModel:
        """See RadianceMethod."""
        return OccNerfModel(self.config, space, generator)

    def loss(self) -> Loss:
        """See RadianceMethod."""
        return occ_nerf_losses(self.config)

    def settings(self) -> dict[str, Any]:
        """See RadianceMethod."""
        return {name: value for name, value in asdict(self.config).items() if name != "volumetric"}
