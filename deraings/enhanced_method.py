"""Any method on enhanced photographs: `3dgs+enhance` is what `3dgs` makes of views with the rain taken out first.

DeRainGS's ablation (d), enhancement without masks, is `3dgs+enhance`; DeRainGS itself learns from the same
`enhanced_scene`.
"""

import logging
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, ClassVar, Self

from baselines.method import Method, TrainingSummary, named
from baselines.training.images import TrainingImages, read_images
from deraings.enhancement.views import EnhancedViews
from deraings.enhancement.weights import DEFAULT, find_weights, load_enhancer
from deraings.image_planes import Plane
from deraings.lens.paleness import MistEvidence, evidence_of_scene
from hydroviews.files.atomic import sha256
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import Image
from hydroviews.scene.masks import mask_name, write_ignored
from hydroviews.scene.scenes import Scene, View

logger = logging.getLogger(__name__)

KEPT = "enhanced"  # pictures, in a run's folder


@dataclass(frozen=True)
class EnhancedConfig:
    """The wrapped method's settings, and by what weights photographs are enhanced.

    Attributes:
        method: of the wrapped method, by its profile.
        enhancement: weights, by name or path.
        weights_sha256: of their file: runs with other weights are other runs.
    """

    method: Any
    enhancement: str
    weights_sha256: str


class OnEnhanced(Method):
    """Shows a method enhanced photographs; all else is the method's own doing."""

    method: ClassVar[type[Method]]

    def __init__(self, config: EnhancedConfig, seed: int) -> None:
        super().__init__(config, seed)
        self._inner = self.method(config.method, seed)

    @classmethod
    def configuration(cls, profile: str) -> EnhancedConfig:
        """See Method.

        Raises:
            InputError: no such profile, or no such weights.
        """
        return EnhancedConfig(cls.method.configuration(profile), DEFAULT, sha256(find_weights(DEFAULT)))

    @classmethod
    def with_max_iterations(cls, config: EnhancedConfig, steps: int) -> EnhancedConfig:
        """See Method; every photograph is enhanced all the same."""
        return replace(config, method=cls.method.with_max_iterations(config.method, steps))

    def fit(self, scene: Scene, folder: Path) -> None:
        """See Method; enhanced photographs are kept in `folder`, and are used if the network finds rain."""
        views = enhanced_views(scene, read_images(scene.train_views), self.config.enhancement, folder / KEPT)
        self._inner.fit(enhanced_scene(scene, views) if views.finds_rain else scene, folder)

    def render(self, camera: Camera) -> Image:
        """See Method."""
        return self._inner.render(camera)

    def hidden(self, view: int, size: tuple[int, int]) -> Plane | None:
        """See Method."""
        return self._inner.hidden(view, size)

    def save(self, folder: Path) -> None:
        """See Method."""
        self._inner.save(folder)

    @classmethod
    def load(cls, config: EnhancedConfig, seed: int, folder: Path) -> Self:
        """See Method."""
        method = cls(config, seed)
        method._inner = cls.method.load(config.method, seed, folder)
        return method

    def summary(self) -> TrainingSummary:
        """See Method; `used` names the weights."""
        inner = self._inner.summary()
        enhancement = f"enhancement {self.config.enhancement}"
        return replace(inner, used=f"{enhancement}, {inner.used}" if inner.used else enhancement)


@cache
def on_enhanced(wrapped: type[Method]) -> type[Method]:
    """The wrapped method, trained on enhanced photographs."""

    class Enhanced(OnEnhanced):
        method = wrapped
        trains_on = wrapped.trains_on

    return named(Enhanced, f"{wrapped.__name__}OnEnhanced", f"{wrapped.__name__} on enhanced photographs.")


def enhanced_views(
    scene: Scene,
    photographs: TrainingImages,
    weights: str,
    folder: Path,
    evidence: Callable[[], MistEvidence] | None = None,
) -> EnhancedViews:
    """The training photographs, each enhanced when it is first asked for; mist stays where it is foggy in the scene.

    Args:
        scene: of which the photographs are the training views.
        photographs: as read.
        weights: of the network, by name or path.
        folder: where enhanced pictures are kept, apart for other photographs and other weights.
        evidence: what photographs and scene points show of mist, if somebody has looked.

    Raises:
        InputError: no such weights.
    """
    enhancer = load_enhancer(weights)
    logger.info(enhancer.reason)
    foggy = (evidence() if evidence else evidence_of_scene(scene, photographs)).foggy
    if foggy:
        logger.info("it is foggy in the scene: the network leaves mist and fog as they are")
    return EnhancedViews(photographs, [view.name for view in scene.train_views], enhancer, folder, not foggy)


def enhanced_scene(scene: Scene, views: EnhancedViews) -> Scene:
    """The scene with enhanced training photographs, showing progress; what masks hide stays hidden.

    Args:
        scene: of which held-out views are left as they are.
        views: its training photographs, enhanced.

    Raises:
        InputError: a mask that cannot be read or has another size than its camera.
    """
    pairs = zip(scene.train_views, views.files(clear=True), strict=True)
    enhanced = {view.name: _enhanced_view(view, path) for view, path in pairs}
    return replace(scene, views=tuple(enhanced.get(view.name, view) for view in scene.views))


def _enhanced_view(view: View, path: Path) -> View:
    """The view with another picture, and its mask beside that: both as the pinhole camera sees them."""
    ignored, mask = view.ignored(), path.with_name(mask_name(path.name))
    if ignored is not None and not mask.is_file():
        write_ignored(mask, ignored)
    return replace(view, path=path, lens=None, mask=None if ignored is None else mask)
