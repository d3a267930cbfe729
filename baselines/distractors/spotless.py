"""SpotLessSplats (Sabour et al. 2025): splatting on the pixels that a network takes for the scene's.

The network (`baselines.masking.feature_network`) sees frozen features of the photographs, so that whole things are
kept or left out, and learns from the residuals (`residuals`). What counts is drawn with its probabilities (`trimmed`).

Departures, beside those of these files: the densification is ours, and SSIM counts as in plain splatting, weighed pixel
by pixel, where the authors' loss is L1 alone. Their reset of the spherical harmonics, in one step, is left out: it cuts
off positive coefficients alone.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

from baselines.encoders.frozen import frozen
from baselines.gaussian_splatting import GaussianSplatting
from baselines.masking.feature_network import FeatureMask, MaskNetwork, MaskNetworkConfig
from baselines.masking.trimmed import TrimConfig
from baselines.method import Citation
from baselines.splatting.backends.base import GSPLAT
from baselines.splatting.config import TrainerConfig
from baselines.splatting.objective import Objective
from baselines.splatting_profiles import PROFILES_WITHOUT_RESETS
from baselines.training.devices import chosen_device
from baselines.training.images import read_images
from baselines.training.torch_state import one_thread
from hydroviews.scene.scenes import Scene


@dataclass(frozen=True)
class SpotlessConfig:
    """Splatting, which pixels it learns from, and the network that tells them."""

    splatting: TrainerConfig
    trim: TrimConfig = field(default_factory=TrimConfig)
    network: MaskNetworkConfig = field(default_factory=MaskNetworkConfig)


SHORT_NETWORK = MaskNetworkConfig("vgg", rate=5e-3, prior=0.9)


class Spotless(GaussianSplatting):
    """SpotLessSplats (Sabour et al. 2025): a network on frozen features predicts the pixels to ignore."""

    citation = Citation(
        title="SpotLessSplats",
        paper="SpotLessSplats: Ignoring Distractors in 3D Gaussian Splatting",
        authors="S. Sabour, L. Goli, G. Kopanas, M. Matthews, D. Lagun, L. Guibas, A. Jacobson and others",
        year=2025,
        link="https://arxiv.org/abs/2406.20055",
        code="https://github.com/lilygoli/SpotLessSplats",
    )

    mask: ClassVar[type[FeatureMask]] = FeatureMask
    profiles: ClassVar[Mapping[str, Any]] = {
        "demo": SpotlessConfig(PROFILES_WITHOUT_RESETS["demo"], network=SHORT_NETWORK),
        "standard": SpotlessConfig(PROFILES_WITHOUT_RESETS["standard"], network=SHORT_NETWORK),
        "paper": SpotlessConfig(PROFILES_WITHOUT_RESETS["paper"]),
    }

    def objective(self, scene: Scene, folder: Path) -> Objective:
        """See GaussianSplatting."""
        config: SpotlessConfig = self.config
        images = read_images(scene.train_views)
        features = frozen(config.network.features, chosen_device(config.splatting.device, GSPLAT))
        with one_thread():
            network = MaskNetwork(images, features, config.network, self.seed, self.mask.extra)
        weights = self.mask(images, config.trim, config.splatting, network, self.seed)
        return Objective(images, config.splatting.lambda_dssim, pixel_weights=weights)
