"""DeRainGS: enhancement of the photographs, then Gaussians and occlusion masks learned from them together.

`DeRainGS` is the paper's method, `DeRainGSPlus` ours, which models the rain that is seen in the photographs. The
classes after them leave parts out, for the ablation.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any, ClassVar

from baselines.gaussian_splatting import PROFILES, GaussianSplatting
from baselines.method import TrainingSummary
from baselines.splatting.config import TrainerConfig
from baselines.training.images import read_images
from deraings.enhancement.views import EnhancedViews, enhanced_images
from deraings.enhancement.weights import find_weights, load_enhancer
from deraings.masks.config import MaskConfig
from deraings.masks.occlusion_masks import OcclusionMasks
from deraings.rain_model.mist_or_fog import may_lift, point_colours
from deraings.rain_model.objective import RainConfig, RainObjective
from deraings.rain_model.report import found
from hydroviews.files.atomic import sha256
from hydroviews.scene.scenes import Scene

NOTHING = RainConfig(veil=None, drops=None, falling=None)


@dataclass(frozen=True)
class DeRainGSConfig:
    """Three switches on top of splatting; each works with or without the others."""

    splatting: TrainerConfig
    enhancement: str | None = None  # weights, by name or path: photographs are enhanced before anything is learned
    masks: MaskConfig | None = None  # occlusion masks
    rain: RainConfig = NOTHING  # kinds of rain that are modelled where the photographs call for them
    witness: str | None = None  # weights: enhanced photographs help to find single streaks, where it rains
    weights_sha256: str | None = None  # of their file: runs with other weights are other runs


def profiles(configure: Callable[[TrainerConfig], DeRainGSConfig]) -> dict[str, DeRainGSConfig]:
    """A configuration for every profile of plain splatting, which trains the same Gaussians for as long."""
    return {name: configure(splatting) for name, splatting in PROFILES.items()}


class DeRainGS(GaussianSplatting):
    """The paper's method: enhancement, and masks with spectral channel attention."""

    profiles: ClassVar[Mapping[str, Any]] = profiles(
        lambda splatting: DeRainGSConfig(splatting, enhancement="small", masks=MaskConfig())
    )

    def __init__(self, config: DeRainGSConfig, seed: int) -> None:
        super().__init__(config, seed)
        self._objective: RainObjective | None = None

    @classmethod
    def configuration(cls, profile: str) -> Any:
        """See GaussianSplatting.

        Raises:
            InputError: no such profile, or no such weights.
        """
        config: DeRainGSConfig = super().configuration(profile)
        weights = config.enhancement or config.witness
        return replace(config, weights_sha256=sha256(find_weights(weights))) if weights else config

    @property
    def splatting(self) -> TrainerConfig:
        """See GaussianSplatting."""
        config: DeRainGSConfig = self.config
        return config.splatting

    def objective(self, scene: Scene, folder: Path) -> RainObjective:
        """See GaussianSplatting; enhanced views are kept in `folder`.

        Raises:
            InputError: an unreadable picture, or no such weights.
        """
        config: DeRainGSConfig = self.config
        images, names = read_images(scene.train_views), [view.name for view in scene.train_views]
        kept, points = folder / "enhanced", cache(partial(point_colours, scene, images))
        lift = may_lift(images, points) if config.enhancement or config.witness else True
        if config.enhancement:
            enhancer = load_enhancer(config.enhancement)
            print(enhancer.reason)
            images = enhanced_images(images, names, enhancer, kept, lift)
            self.found["enhancement"] = config.enhancement if lift else f"{config.enhancement} leaving fog as it is"
        iterations = config.splatting.iterations
        masks = OcclusionMasks(images, iterations, self.seed, config.masks) if config.masks else None
        derained = EnhancedViews(images, names, load_enhancer(config.witness), kept, lift) if config.witness else None
        lambda_dssim = config.splatting.lambda_dssim
        self._objective = RainObjective(images, iterations, config.rain, lambda_dssim, masks, derained, points)
        return self._objective

    def fit(self, scene: Scene, folder: Path) -> None:
        """See Method."""
        super().fit(scene, folder)
        self.found |= found(self.learned())

    def learned(self) -> RainObjective:
        """What was learned of the rain in the training views, after `fit`."""
        assert self._objective is not None
        return self._objective

    def summary(self) -> TrainingSummary:
        """See Method; `used` says what was found in the photographs."""
        texts = {name: " and ".join(v) or "nothing" if isinstance(v, list) else v for name, v in self.found.items()}
        return replace(super().summary(), used=", ".join(f"{name} {text}" for name, text in texts.items()))


class DeRainGSPlus(DeRainGS):
    """The rain is modelled: a veil and drops on the lens, falling rain that only adds light; the network is a witness.

    The photographs stay what the scene is learned from; where it rains, enhanced ones help to tell what is rain.
    """

    profiles: ClassVar[Mapping[str, Any]] = profiles(
        lambda splatting: DeRainGSConfig(splatting, rain=RainConfig(), witness="small")
    )


class RainModel(DeRainGS):
    """Ablation: the rain model without a network."""

    profiles: ClassVar[Mapping[str, Any]] = profiles(lambda splatting: DeRainGSConfig(splatting, rain=RainConfig()))


class Masks(DeRainGS):
    """Ablation (c): masks on the photographs as they are."""

    profiles: ClassVar[Mapping[str, Any]] = profiles(lambda splatting: DeRainGSConfig(splatting, masks=MaskConfig()))


class Enhancement(DeRainGS):
    """Ablation (d): enhanced photographs, no masks."""

    profiles: ClassVar[Mapping[str, Any]] = profiles(lambda splatting: DeRainGSConfig(splatting, enhancement="small"))


class WithoutAttention(DeRainGS):
    """Ablation (e): all of the paper's method but the attention in the mask network."""

    profiles: ClassVar[Mapping[str, Any]] = profiles(
        lambda splatting: DeRainGSConfig(splatting, enhancement="small", masks=MaskConfig(attention=False))
    )


class Everything(DeRainGS):
    """Enhancement, masks and the rain model, but for falling rain, which would be taken off twice."""

    profiles: ClassVar[Mapping[str, Any]] = profiles(
        lambda splatting: DeRainGSConfig(
            splatting, enhancement="small", masks=MaskConfig(), rain=RainConfig(falling=None)
        )
    )
