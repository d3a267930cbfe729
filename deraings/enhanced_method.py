"""Any method on enhanced photographs: `3dgs+enhance` is what `3dgs` makes of views with the rain taken out first.

`3dgs+enhance` computes what the ablation `deraings.method:Enhancement` does, to the same bits.
"""

from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any, ClassVar, Self

from tqdm import tqdm

from baselines.method import Method, TrainingSummary
from baselines.training.images import read_images
from deraings.enhancement.views import EnhancedViews
from deraings.enhancement.weights import DEFAULT, Enhancer, find_weights, load_enhancer
from deraings.rain_model.mist_or_fog import may_lift, point_colours
from hydroviews.files.atomic import sha256
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import Image
from hydroviews.scene.masks import mask_name, write_ignored
from hydroviews.scene.scenes import Scene, View

KEPT = "enhanced"  # pictures, in a run's folder


@dataclass(frozen=True)
class EnhancedConfig:
    """The wrapped method's settings, and by what weights photographs are enhanced."""

    method: Any
    enhancement: str  # by name or path
    weights_sha256: str  # of their file: runs with other weights are other runs


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
        """See Method; enhanced photographs are kept in `folder`."""
        enhancer = load_enhancer(self.config.enhancement)
        print(enhancer.reason)
        self._inner.fit(enhanced_scene(scene, enhancer, folder / KEPT), folder)

    def render(self, camera: Camera) -> Image:
        """See Method."""
        return self._inner.render(camera)

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
def on_enhanced(method: type[Method]) -> type[Method]:
    """The method that learns from enhanced photographs what `method` learns from them as they are."""
    about = {"__module__": __name__, "__doc__": f"{method.__name__} on enhanced photographs."}
    return type(
        f"{method.__name__}OnEnhanced", (OnEnhanced,), {**about, "method": method, "trains_on": method.trains_on}
    )


def enhanced_scene(scene: Scene, enhancer: Enhancer, folder: Path) -> Scene:
    """The scene with enhanced training photographs, showing progress; what masks hide stays hidden.

    Args:
        scene: of which held-out views are left as they are.
        enhancer: the network.
        folder: where enhanced photographs are kept, apart for other photographs and other weights.

    Raises:
        InputError: a picture or mask that cannot be read or has another size than its camera.
    """
    views, images = scene.train_views, read_images(scene.train_views)
    lift = may_lift(images, partial(point_colours, scene, images))
    pictures = EnhancedViews(images, [view.name for view in views], enhancer, folder, lift)
    progress = tqdm(views, desc="enhancing", unit="view", leave=False)
    enhanced = {view.name: _enhanced_view(view, pictures.file(index)) for index, view in enumerate(progress)}
    return replace(scene, views=tuple(enhanced.get(view.name, view) for view in scene.views))


def _enhanced_view(view: View, path: Path) -> View:
    """The view with another picture, and its mask beside that: both as the pinhole camera sees them."""
    ignored, mask = view.ignored(), path.with_name(mask_name(path.name))
    if ignored is not None and not mask.is_file():
        write_ignored(mask, ignored)
    return replace(view, path=path, lens=None, mask=None if ignored is None else mask)
