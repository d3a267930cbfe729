"""Wild-GS (Xu et al. 2024): splatting for photographs whose light differs, in the whole and from place to place.

A Gaussian's colour in a view is made of a code of the photograph as a whole, of a code of the place, which it reads
from a triplane of the photograph's own pixels, lifted by the rendered depth, and of numbers of its own (`colours`,
`triplane`, `lifting`, `appearance`). A visibility mask (`masking.visibility`) weighs the loss, at a price that falls.
There is no code by the authors: what the paper does not give is chosen here, see `config`.

Departures from the paper, in all profiles:
  - Held-out views are rendered in the mean look (`mean_look`): the trained model is ordinary Gaussians. The paper looks
    at the held-out photograph itself.
  - The networks say what is added to the Gaussians' own spherical harmonics.
  - The mask weighs the loss of each pixel; the paper multiplies both pictures by it.
  - No loss on depths: the paper compares with a network's, which needs weights.
  - A view's depth is rendered anew every some hundred steps, not in each.
  - The box is laid over the first Gaussians without the outermost hundredth, and stays.
  - ResNet-18 learns from scratch unless $HYDROVIEWS_RESNET18 names a file of its weights.
Short profiles besides: GS-W's small U-Net on a reference of half the size, a triplane of 64 x 64, and in every second
step Gaussians know nothing of the reference.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar

from baselines.encoders.objective import PerceptualObjective
from baselines.encoders.resnet_weights import encoder_used, load_resnet, with_named_weights
from baselines.gaussian_splatting import MASKED, GaussianSplatting
from baselines.method import Citation, TrainingSummary
from baselines.splatting.config import TrainerConfig
from baselines.splatting.strategies.initialisation import scene_extent
from baselines.splatting_profiles import PROFILES_WITH_NETWORKS, with_iterations
from baselines.training.images import read_images
from baselines.training.torch_state import one_thread
from baselines.wild_gs.appearance import LookAppearance
from baselines.wild_gs.config import PAPER, SHORT, LookConfig
from baselines.wild_gs.mean_look import mean_look
from hydroviews.scene.scenes import Scene


@dataclass(frozen=True)
class WildGSConfig:
    """Gaussians and networks."""

    splatting: TrainerConfig = field(default_factory=TrainerConfig)
    look: LookConfig = PAPER


class WildGS(GaussianSplatting):
    """Wild-GS (Xu et al. 2024): splatting with global and local appearance and a visibility mask.

    The trained model has the mean appearance: ordinary Gaussians.
    """

    citation = Citation(
        title="Wild-GS",
        paper="Wild-GS: Real-Time Novel View Synthesis from Unconstrained Photo Collections",
        authors="J. Xu, Y. Mei, V. M. Patel",
        year=2024,
        link="https://arxiv.org/abs/2406.10373",
    )

    profiles: ClassVar[Mapping[str, Any]] = {
        "demo": WildGSConfig(PROFILES_WITH_NETWORKS["demo"], SHORT),
        "standard": WildGSConfig(with_iterations(6500, PROFILES_WITH_NETWORKS["standard"]), SHORT),
        "paper": WildGSConfig(),
    }

    @classmethod
    def configuration(cls, profile: str) -> Any:
        """See GaussianSplatting.

        Raises:
            InputError: no such profile, or no such weights.
        """
        config: WildGSConfig = super().configuration(profile)
        return replace(config, look=with_named_weights(config.look))

    def objective(self, scene: Scene, folder: Path) -> PerceptualObjective:
        """See GaussianSplatting.

        Raises:
            InputError: an unreadable picture, or weights that are none.
        """
        splatting, look, images = self.splatting, self.config.look, read_images(scene.train_views)
        cameras = [view.camera for view in scene.train_views]
        near = splatting.near * scene_extent(cameras, scene.points.positions)[1]
        appearance = LookAppearance(
            images, look, splatting.sh_degree, splatting.iterations, self.seed, near, splatting.antialiased
        )
        if look.weights:
            load_resnet(appearance.encoder.backbone, Path(look.weights))
        return PerceptualObjective(images, splatting.lambda_dssim, appearance)

    @one_thread()
    def fit(self, scene: Scene, folder: Path) -> None:
        """See Method; then the references have done their part."""
        super().fit(scene, folder)
        trained, appearance = self._require(), self._objective and self._objective.appearance
        assert isinstance(appearance, LookAppearance)
        cameras = [view.camera for view in scene.train_views]
        shown = mean_look(trained.gaussians, appearance, cameras, trained.near, self.splatting.antialiased)
        self._trained = replace(trained, gaussians=shown)
        self.note_masked(appearance.masked())

    def summary(self) -> TrainingSummary:
        """See Method; `used` names the encoder, and how much of the photographs was masked at the end."""
        return replace(super().summary(), used=encoder_used(self.config.look, self.found[MASKED]))
