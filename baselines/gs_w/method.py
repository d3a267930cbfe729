"""GS-W, Gaussian in the Wild (Zhang et al. 2024): splatting for photographs that do not look alike.

Every Gaussian has an intrinsic feature of its own and a dynamic one, which is read from feature maps of the reference
picture, in training the view itself: where the view shows the Gaussian (projection map) and at learned coordinates
(K adaptive maps). A network makes colours of both and the viewing direction. What else comes and goes is left out of
the loss by a visibility mask. The parts are beside it.

Departures from the paper, in all profiles:
  - Held-out views are rendered with the mean of each Gaussian's dynamic features over the training views, as the
    benchmark's protocol asks; the paper takes them from the held-out photograph itself.
  - Networks say what is added to the intrinsic feature's first three numbers, a colour, and not the colour itself.
  - The mask weighs the loss of each pixel; the authors' code multiplies both pictures by it.
  - No batch normalisation in training; see `encoder`. ResNet-18 learns from scratch unless
    $HYDROVIEWS_RESNET18 names a file of its weights, which the record then names.
  - The coordinates' box is as large as the map from the start; they move at a rate of 0.004, theirs at 1.
Short profiles besides: a small U-Net on a reference of half the size, smaller networks, a larger rate of coordinates,
no LPIPS.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np

from baselines.encoders.objective import PerceptualObjective
from baselines.encoders.resnet_weights import encoder_used, load_resnet, with_named_weights
from baselines.gaussian_splatting import MASKED, GaussianSplatting
from baselines.gs_w.appearance import ReferenceAppearance
from baselines.gs_w.config import SHORT, ReferenceConfig
from baselines.gs_w.fusion import Fusion
from baselines.gs_w.mean_appearance import average_features, coloured_for, mean_colours
from baselines.method import Citation, TrainingSummary
from baselines.splatting.config import TrainerConfig
from baselines.splatting.gaussians import Gaussians
from baselines.splatting.schedule import LearningRates
from baselines.splatting.strategies.densification import DefaultStrategy
from baselines.splatting_profiles import PROFILES_WITH_NETWORKS, with_iterations
from baselines.training.checkpoints import MODEL, megabytes, read_arrays, write_arrays
from baselines.training.images import read_images
from baselines.training.torch_state import module_arrays, one_thread, restore_module
from hydroviews.errors import InputError
from hydroviews.scene.cameras import Camera
from hydroviews.scene.scenes import Scene

NETWORK = "network.safetensors"
SHOWN = "shown"  # colours for viewers, beside the network


@dataclass(frozen=True)
class GSWConfig:
    """Gaussians and networks."""

    splatting: TrainerConfig
    appearance: ReferenceConfig = field(default_factory=ReferenceConfig)


class GaussianInTheWild(GaussianSplatting):
    """GS-W (Zhang et al. 2024): splatting with appearance per view and a visibility mask."""

    citation = Citation(
        title="Gaussian in the Wild",
        paper="Gaussian in the Wild: 3D Gaussian Splatting for Unconstrained Image Collections",
        authors="D. Zhang, C. Wang, W. Wang, P. Li, M. Qin, H. Wang",
        year=2024,
        link="https://arxiv.org/abs/2403.15704",
        code="https://github.com/EastbeanZhang/Gaussian-Wild",
    )

    profiles: ClassVar[Mapping[str, Any]] = {
        "demo": GSWConfig(PROFILES_WITH_NETWORKS["demo"], SHORT),
        "standard": GSWConfig(with_iterations(5500, PROFILES_WITH_NETWORKS["standard"]), SHORT),
        "paper": GSWConfig(
            TrainerConfig(
                iterations=70_000,
                learning_rates=LearningRates(means_final=1.6e-7, sh=1.25e-4, sh_rest=1.25e-4),
                strategy=DefaultStrategy(grow_grad2d=4e-4),
            )
        ),
    }

    def __init__(self, config: GSWConfig, seed: int) -> None:
        super().__init__(config, seed)
        self._fusion = Fusion(config.appearance, config.splatting.sh_degree)
        self._shown = np.zeros((0, 3), np.float32)

    @classmethod
    def configuration(cls, profile: str) -> Any:
        """See GaussianSplatting.

        Raises:
            InputError: no such profile, or no such weights.
        """
        config: GSWConfig = super().configuration(profile)
        return replace(config, appearance=with_named_weights(config.appearance))

    def objective(self, scene: Scene, folder: Path) -> PerceptualObjective:
        """See GaussianSplatting.

        Raises:
            InputError: an unreadable picture, or weights that are none.
        """
        config: GSWConfig = self.config
        splatting, images = config.splatting, read_images(scene.train_views)
        appearance = ReferenceAppearance(
            images, config.appearance, splatting.sh_degree, splatting.iterations, self.seed
        )
        if config.appearance.weights:
            load_resnet(appearance.encoder.backbone, Path(config.appearance.weights))
        return PerceptualObjective(images, splatting.lambda_dssim, appearance)

    @one_thread()
    def fit(self, scene: Scene, folder: Path) -> None:
        """See Method; then the references have done their part."""
        super().fit(scene, folder)
        trained, appearance = self._require(), self._objective and self._objective.appearance
        assert isinstance(appearance, ReferenceAppearance)
        cameras = [view.camera for view in scene.train_views]
        seen_with = trained.near, self.splatting.antialiased
        gaussians = average_features(trained.gaussians, appearance, cameras, *seen_with)
        self._trained = replace(trained, gaussians=gaussians)
        self.note_masked(appearance.masked())
        self._fusion = appearance.cpu().fusion
        self._shown = mean_colours(gaussians, self._fusion, cameras, *seen_with)

    def gaussians_for_camera(self, camera: Camera) -> Gaussians:
        """See GaussianSplatting; with the mean appearance."""
        return coloured_for(self._require().gaussians, self._fusion, camera)

    def export_gaussians(self) -> Gaussians:
        """See GaussianSplatting; what is added to the Gaussians' own colours is the mean over the training cameras."""
        gaussians = self._require().gaussians
        return replace(gaussians.bare(), sh=np.concatenate([self._shown[:, None], gaussians.sh[:, 1:]], axis=1))

    def save(self, folder: Path) -> None:
        """See GaussianSplatting; and the network."""
        super().save(folder)
        write_arrays(folder / NETWORK, {**module_arrays(self._fusion), SHOWN: self._shown}, {})
        self._model_mb = _megabytes(folder)

    @classmethod
    def load(cls, config: Any, seed: int, folder: Path) -> Self:
        """See Method."""
        method = super().load(config, seed, folder)
        arrays, _ = read_arrays(folder / NETWORK)
        try:
            restore_module(method._fusion, arrays)
            method._shown = arrays[SHOWN]
        except (KeyError, RuntimeError) as error:
            fix = "load it with the settings it was trained with, or train it again"
            raise InputError(f"{folder / NETWORK}: another network", found=error, fix=fix) from error
        method._model_mb = _megabytes(folder)
        return method

    def summary(self) -> TrainingSummary:
        """See Method; `used` names the encoder, and how much of the photographs was masked at the end."""
        return replace(super().summary(), used=encoder_used(self.config.appearance, self.found[MASKED]))


def _megabytes(folder: Path) -> float:
    return sum(megabytes(folder / name) for name in (MODEL, NETWORK))
