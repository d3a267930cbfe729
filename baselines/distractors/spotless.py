"""SpotLessSplats (Sabour et al. 2025): splatting on the pixels that a network takes for the scene's.

The network (`mask_network.py`) sees frozen features of the photographs, so that whole things are kept or left out, and
learns from the residuals (`residuals.py`). What counts is drawn with its probabilities (`trimming.py`).

Departures, beside those of these files: the densification is ours, and SSIM counts as in plain splatting, weighed pixel
by pixel, where the authors' loss is L1 alone. Their reset of the spherical harmonics, in one step, is left out: it cuts
off positive coefficients alone.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

from numpy.typing import NDArray

from baselines.distractors.mask_network import MaskNetwork, MaskNetworkConfig, frozen
from baselines.distractors.trimming import TrimConfig, TrimmedMethod, TrimmedObjective
from baselines.method import Citation
from baselines.splatting.backends.base import GSPLAT
from baselines.splatting.config import TrainerConfig
from baselines.splatting.kernels.photometric import Plane
from baselines.splatting_profiles import PROFILES_WITHOUT_RESETS
from baselines.training.checkpoints import below, prefixed
from baselines.training.devices import chosen_device
from baselines.training.images import TrainingImages, read_images
from baselines.training.torch_state import one_thread
from hydroviews.scene.masks import Ignored
from hydroviews.scene.scenes import Scene


@dataclass(frozen=True)
class SpotlessConfig:
    """Splatting, which pixels it learns from, and the network that tells them."""

    splatting: TrainerConfig
    trim: TrimConfig = field(default_factory=TrimConfig)
    network: MaskNetworkConfig = field(default_factory=MaskNetworkConfig)


class SpotlessObjective(TrimmedObjective):
    """The photometric loss over the pixels that the network takes for the scene's."""

    def __init__(self, images: TrainingImages, config: SpotlessConfig, network: MaskNetwork, seed: int) -> None:
        super().__init__(images, config, seed)
        self.network = network

    def probability(self, residuals: Plane, view: int, ignored: Ignored | None) -> Plane:
        """See TrimmedObjective; the network takes a step."""
        lower, upper = (
            self.below(residuals, share, ignored) for share in (self.network.config.lower, self.network.config.upper)
        )
        with one_thread():
            return self.network.learn(view, lower, upper, ignored, self.context(view))

    def predicted(self, residuals: Plane, view: int, ignored: Ignored | None) -> Plane:
        """See TrimmedObjective."""
        with one_thread():
            return self.network.probability(view, residuals.shape, self.context(view))

    def context(self, view: int) -> Sequence[Plane]:
        """What the network sees of a view beside its features; here nothing."""
        return ()

    def report(self) -> dict[str, Any]:
        """See Objective; the features that the network saw as well."""
        return {"features": self.network.config.features, **super().report()}

    def settings(self) -> dict[str, Any]:
        """See Objective."""
        return {**super().settings(), "network": self.network.settings()}

    def state_dict(self) -> dict[str, NDArray]:
        """See Objective."""
        learned = self.network.state_dict()
        return super().state_dict() | prefixed("masks", learned)

    def load_state_dict(self, arrays: dict[str, NDArray]) -> None:
        """See Objective."""
        super().load_state_dict(arrays)
        self.network.load_state_dict(below("masks", arrays))


SHORT_NETWORK = MaskNetworkConfig("vgg", rate=5e-3, prior=0.9)


class Spotless(TrimmedMethod):
    """SpotLessSplats (Sabour et al. 2025): a network on frozen features predicts the pixels to ignore."""

    citation = Citation(
        title="SpotLessSplats",
        paper="SpotLessSplats: Ignoring Distractors in 3D Gaussian Splatting",
        year=2025,
        link="https://arxiv.org/abs/2406.20055",
    )

    extra: ClassVar[int] = 0  # planes that the network sees beside the features
    profiles: ClassVar[Mapping[str, Any]] = {
        "demo": SpotlessConfig(PROFILES_WITHOUT_RESETS["demo"], network=SHORT_NETWORK),
        "quick": SpotlessConfig(PROFILES_WITHOUT_RESETS["quick"], network=SHORT_NETWORK),
        "paper": SpotlessConfig(PROFILES_WITHOUT_RESETS["paper"]),
    }

    def objective(self, scene: Scene, folder: Path) -> SpotlessObjective:
        """See GaussianSplatting."""
        config: SpotlessConfig = self.config
        images = read_images(scene.train_views)
        features = frozen(config.network.features, chosen_device(config.splatting.device, GSPLAT))
        with one_thread():
            network = MaskNetwork(images, features, config.network, self.seed, self.extra)
        return self.compared_by(images, network)

    def compared_by(self, images: TrainingImages, network: MaskNetwork) -> SpotlessObjective:
        """The objective on given photographs."""
        return SpotlessObjective(images, self.config, network, self.seed)
