"""DeRainGS: enhancement of the photographs, then Gaussians and occlusion masks learned from them together.

`DeRainGS` is the paper's method, `DeRainGSPlus` ours, which models the rain that is seen in the photographs. The
classes after them leave parts out, for the ablation; enhancement without masks is `3dgs+enhance`.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any, ClassVar

from baselines.gaussian_splatting import GaussianSplatting
from baselines.method import Citation
from baselines.splatting.backends.base import GSPLAT
from baselines.splatting.config import TrainerConfig
from baselines.splatting.objective import Objective
from baselines.splatting_profiles import PROFILES
from baselines.training.devices import chosen_device
from baselines.training.images import TrainingImages, read_images
from deraings.enhanced_method import KEPT, enhanced_views
from deraings.enhancement.views import EnhancedViews
from deraings.enhancement.weights import DEFAULT, find_weights
from deraings.lens.paleness import evidence_of_scene
from deraings.masks.config import MaskConfig
from deraings.masks.occlusion_masks import OcclusionMasks
from deraings.rain_model.config import RainConfig
from deraings.rain_model.objective import RainObjective
from hydroviews.errors import InputError
from hydroviews.files.atomic import sha256
from hydroviews.scene.scenes import Scene

SHORT_TRAINING = 2000  # iterations, below which a training is short


@dataclass(frozen=True)
class DeRainGSConfig:
    """What is added to splatting; each part works with or without the others.

    Attributes:
        splatting: how the Gaussians are trained, as for plain 3DGS.
        enhancement: weights, by name or path; the scene is then learned from enhanced photographs, if they show rain.
        masks: occlusion masks; None for none.
        rain: kinds of rain that are modelled where the photographs call for them; None for no model of rain.
        prior: weights, by name or path; the network is then a second opinion on mist and single streaks; the
            scene is learned from the photographs as they are, and behind mist that the network knows from enhanced
            ones as well.
        weights_sha256: of the file of the weights: runs with other weights are other runs.

    Raises:
        ValueError: both enhancement and prior.
    """

    splatting: TrainerConfig
    enhancement: str | None = None
    masks: MaskConfig | None = None
    rain: RainConfig | None = None
    prior: str | None = None
    weights_sha256: str | None = None

    def __post_init__(self) -> None:
        if self.enhancement and self.prior:
            raise ValueError("enhanced photographs are either learned from or a prior, not both")

    @property
    def weights(self) -> str | None:
        """Of the network, by name or path, if one is used."""
        return self.enhancement or self.prior


def masks_for(splatting: TrainerConfig, **changed: Any) -> MaskConfig:
    """Masks whose network learns in every twelfth iteration, in the shortest trainings in every sixth."""
    return MaskConfig(every=6 if splatting.iterations < SHORT_TRAINING else 12, **changed)


def paper_config(splatting: TrainerConfig, **changed: Any) -> DeRainGSConfig:
    """The paper's method, with masks that are changed in some settings."""
    return DeRainGSConfig(splatting, enhancement=DEFAULT, masks=masks_for(splatting, **changed))


def profiles(configure: Callable[[TrainerConfig], DeRainGSConfig]) -> dict[str, DeRainGSConfig]:
    """A configuration for every profile of plain splatting, whose training all of these methods have."""
    return {name: configure(trained) for name, trained in PROFILES.items()}


class DeRainGS(GaussianSplatting):
    """DeRainGS (Liu et al. 2025), re-implemented: enhanced photographs, and masks with spectral channel attention."""

    citation = Citation(
        title="DeRainGS, re-implemented",
        paper="DeRainGS: Gaussian Splatting for Enhanced Scene Reconstruction in Rainy Environments",
        authors="S. Liu, X. Chen, H. Chen, Q. Xu, M. Li",
        year=2025,
        link="https://arxiv.org/abs/2408.11540",
    )

    profiles: ClassVar[Mapping[str, Any]] = profiles(paper_config)

    @classmethod
    def configuration(cls, profile: str) -> Any:
        """See GaussianSplatting.

        Raises:
            InputError: no such profile, or no such weights.
        """
        config: DeRainGSConfig = super().configuration(profile)
        return replace(config, weights_sha256=sha256(find_weights(config.weights))) if config.weights else config

    def objective(self, scene: Scene, folder: Path) -> Objective:
        """See GaussianSplatting; enhanced views are kept in `folder`.

        Raises:
            InputError: an unreadable picture, or no such weights.
        """
        config: DeRainGSConfig = self.config
        images = read_images(scene.train_views)
        evidence = cache(partial(evidence_of_scene, scene, images))
        views = enhanced_views(scene, images, config.weights, folder / KEPT, evidence) if config.weights else None
        enhanced = views if views and config.enhancement and views.finds_rain else None
        if enhanced:
            images = enhanced.training_images(clear=True)
            evidence = cache(partial(evidence_of_scene, scene, images))
        if views and config.enhancement:
            self.found["enhancement"] = config.enhancement + _how_enhanced(views)
        masks = self._masks(images, enhanced)
        if config.rain is None:
            return Objective(images, config.splatting.lambda_dssim, pixel_weights=masks)
        return RainObjective(
            images,
            config.splatting.iterations,
            config.rain,
            config.splatting.lambda_dssim,
            pixel_weights=masks,
            network=views if config.prior else None,
            evidence=evidence,
            covers=views,
        )

    def _masks(self, images: TrainingImages, enhanced: EnhancedViews | None) -> OcclusionMasks | None:
        config: DeRainGSConfig = self.config
        if config.masks is None:
            return None
        known, wet = None, False
        if enhanced and enhanced.tells_cover:
            known, wet = enhanced.hidden_by_drops, enhanced.wet
        device = chosen_device(config.splatting.device, GSPLAT)
        return OcclusionMasks(images, config.splatting.iterations, self.seed, config.masks, known, wet, device)

    def learned(self) -> RainObjective:
        """What was learned of the rain in the training views, after `fit`.

        Raises:
            InputError: not trained here, or without a model of rain; a model that was loaded holds the scene alone.
        """
        if not isinstance(self._objective, RainObjective):
            raise InputError(f"{type(self).__name__}: no rain has been learned", fix="call fit first")
        return self._objective


def _how_enhanced(views: EnhancedViews) -> str:
    """The words that a record adds to the weights, if views were enhanced in an unusual way."""
    fog = "" if views.remove_mist else " leaving fog as it is"
    return fog if views.finds_rain else fog + ", which finds no rain"


class DeRainGSPlus(DeRainGS):
    """Our method: a model of mist and drops on the lens, falling rain and streaks; the network is its prior.

    The scene is trained on the unchanged photographs; in rain, enhanced photographs help to separate rain from scene.
    """

    citation = Citation(
        title="DeRainGS with a rain model (this project)",
    )

    profiles: ClassVar[Mapping[str, Any]] = profiles(
        lambda splatting: DeRainGSConfig(splatting, rain=RainConfig(), prior=DEFAULT)
    )


class RainModelOnly(DeRainGS):
    """Ablation: the rain model without a network."""

    profiles: ClassVar[Mapping[str, Any]] = profiles(lambda splatting: DeRainGSConfig(splatting, rain=RainConfig()))


class Masks(DeRainGS):
    """Ablation (c): masks on the photographs as they are."""

    profiles: ClassVar[Mapping[str, Any]] = profiles(
        lambda splatting: DeRainGSConfig(splatting, masks=masks_for(splatting))
    )


class WithoutAttention(DeRainGS):
    """Ablation (e): all of the paper's method but the attention in the mask network."""

    profiles: ClassVar[Mapping[str, Any]] = profiles(lambda splatting: paper_config(splatting, attention=False))


class Everything(DeRainGS):
    """Enhancement, masks and the rain model, but for what would be taken off twice.

    That is falling rain, and drops that stay as the network sees them, which masks hide.
    """

    profiles: ClassVar[Mapping[str, Any]] = profiles(
        lambda splatting: DeRainGSConfig(
            splatting,
            enhancement=DEFAULT,
            masks=masks_for(splatting),
            rain=RainConfig(rainfall=None, occlusion=None),
        )
    )
