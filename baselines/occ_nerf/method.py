"""Occlusion-free NeRF (Zhu et al. 2023): the scene behind what stands far before it.

A field of everything is trained on the photographs. Along its rays a detector compares the depth of what is seen first
with that of the last surface (`depths.py`, `detector.py`); a second field learns where both agree, and is shown.

Where this deviates from the public code, beside the tables of docs/methods/radiance-fields.md:

* Rays are drawn from all views, not 32 x 32 from one photograph: without features of pictures no loss looks at
  neighbours, and a step that sees all views is steadier.
* The background begins with the whole learning rate, which has fallen by then.
* Scenes that are seen from all sides are contracted; their depths are 1 - near / t.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import torch
from numpy.typing import NDArray

from baselines.method import Citation, TrainingSummary
from baselines.occ_nerf.config import OccNerfConfig
from baselines.occ_nerf.losses import occ_nerf_losses
from baselines.occ_nerf.model import OccNerfModel
from baselines.training.images import Size
from baselines.volumetric.config import DETAILED_FIELD, NERF, SHORT_FIELD, MlpFieldConfig, VolumetricConfig
from baselines.volumetric.losses import Loss
from baselines.volumetric.method import RadianceMethod
from baselines.volumetric.rays.rays import WorldRays, camera_rays
from baselines.volumetric.rays.spaces import Space
from hydroviews.scene.cameras import Camera
from hydroviews.scene.scenes import Scene

STRIDE = 13  # of the pixels whose share of foreground is told, over all views
# As much processor time as `nerf-w` has: a step with two fields costs some 1.4 of its.
DEMO = VolumetricConfig(field=SHORT_FIELD, iterations=2500)
STANDARD = VolumetricConfig(field=DETAILED_FIELD, iterations=9500)
# Chosen on courtyard; docs/methods/radiance-fields.md says why none of the three is the public code's.
SHORT = {"gap": 0.4, "alone": 0.1, "depth_weight": 0.1}
# The public code's networks. Its 100 epochs of 32 x 32 pixels are some 560,000 steps for 30 photographs of 504 x 378.
EVERYTHING = MlpFieldConfig(width=128, depth=6, rate=3e-4)
BEHIND = replace(EVERYTHING, depth=8)
PAPER = replace(NERF, field=EVERYTHING, iterations=560_000, final_rate=1 / 30)
PROFILES = {
    "demo": OccNerfConfig(DEMO, SHORT_FIELD, **SHORT),
    "standard": OccNerfConfig(STANDARD, DETAILED_FIELD, **SHORT),
    "paper": OccNerfConfig(PAPER, BEHIND, detector_rate=1e-4),
}


class OccNerf(RadianceMethod):
    """Occlusion-free NeRF (Zhu et al. 2023): one field of everything selects the pixels of a background field."""

    citation = Citation(
        title="Occlusion-free NeRF",
        paper="Occlusion-Free Scene Recovery via Neural Radiance Fields",
        authors="C. Zhu, R. Wan, Y. Tang, B. Shi",
        year=2023,
    )

    profiles: ClassVar[Mapping[str, Any]] = PROFILES

    def __init__(self, config: OccNerfConfig, seed: int) -> None:
        super().__init__(config, seed)
        self._foreground: float | None = None  # share of the training pixels
        self._cameras: tuple[Camera, ...] = ()  # of the training views, after `fit`

    @property
    def model(self) -> OccNerfModel:
        """The trained fields.

        Raises:
            InputError: not trained.
        """
        model = self._require().trained.model
        assert isinstance(model, OccNerfModel)
        return model

    def make(self, space: Space, generator: torch.Generator, views: int) -> OccNerfModel:
        """See RadianceMethod."""
        return OccNerfModel(self.config, space, generator)

    def loss(self) -> Loss:
        """See RadianceMethod."""
        return occ_nerf_losses(self.config)

    def fit(self, scene: Scene, folder: Path) -> None:
        """See Method."""
        super().fit(scene, folder)
        self._foreground = foreground_share(self.model, scene)
        self._cameras = tuple(view.camera for view in scene.train_views)

    def hidden(self, view: int, size: Size) -> NDArray[np.float32] | None:
        """See Method: what the detector says."""
        if not self._cameras:
            return None
        rays = camera_rays(self._cameras[view].resized(size[1], size[0]))
        return foreground(self.model, rays).reshape(size)

    def summary(self) -> TrainingSummary:
        """See Method."""
        used = "" if self._foreground is None else f"{self._foreground:.1%} of the pixels taken for foreground"
        return replace(super().summary(), used=used)


def foreground_share(model: OccNerfModel, scene: Scene) -> float:
    """The share of the training views' pixels that the detector takes for foreground, from every 13th."""
    found = []
    for view in scene.train_views:
        world = camera_rays(view.camera)
        some = replace(world, origins=world.origins[::STRIDE], directions=world.directions[::STRIDE])
        found.append(foreground(model, some) >= 0.5)
    return float(np.mean(np.concatenate(found)))


def foreground(model: OccNerfModel, world: WorldRays) -> NDArray[np.float32]:
    """What the detector says of rays in the world [R], in [0, 1]."""
    rays = model.space.from_world(world, next(model.parameters()).device)
    return torch.cat([model.foreground(part) for part in model.chunks(rays)]).cpu().numpy()
