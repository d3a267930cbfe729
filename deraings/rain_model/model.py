"""The rain between scene and photograph, all of it: falling rain, then mist on the lens, then drops on the lens.

`RainModel.forward` shows a rendered view through the rain, `backward` takes the gradient back through it, and `update`
learns of the rain from a view that has been compared with its photograph.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.kernels.photometric import Target
from baselines.training.checkpoints import below, prefixed
from baselines.training.images import TrainingImages
from deraings.enhancement.views import EnhancedViews
from deraings.image_planes import Plane, product
from deraings.rain_model.drops import DropLayer, LensDropsConfig
from deraings.rain_model.drops_by_shape import DropsByShape
from deraings.rain_model.enhanced_target import EnhancedStart, EnhancedTarget, EnhancedTargetConfig
from deraings.rain_model.falling_rain import FallingRain
from deraings.rain_model.mist import Mist, MistConfig, MistGradient, difference_gradient
from deraings.rain_model.observation import Observation
from deraings.rain_model.rain_layer import RainLayerConfig
from deraings.rain_model.renewed_drops import RenewedDrops, RenewedDropsConfig
from deraings.rain_model.staying_drops import StayingDrops, StayingDropsConfig
from deraings.rain_model.streaks import SingleStreaksConfig
from deraings.rain_model.warm_up import warm_up
from hydroviews.scene.images import Image
from hydroviews.scene.point_colours import PointColours


@dataclass(frozen=True)
class RainConfig:
    """Which kinds of rain are looked for; None leaves one out.

    Attributes:
        mist: on the lens.
        drops: on the lens, where they stay.
        staying: the same as a network sees them; looked for only beside `drops`, where one says what drops cover.
        renewed: drops on the lens that are new in every view; looked for only where a network says what drops cover.
        rain_layer: falling rain, even.
        streaks: single ones, looked for only where falling rain is.
        enhanced: photographs that a network enhanced, which a scene behind mist is learned from as well, and one in
            streaks at first.
    """

    mist: MistConfig | None = field(default_factory=MistConfig)
    drops: LensDropsConfig | None = field(default_factory=LensDropsConfig)
    staying: StayingDropsConfig | None = field(default_factory=StayingDropsConfig)
    renewed: RenewedDropsConfig | None = field(default_factory=RenewedDropsConfig)
    rain_layer: RainLayerConfig | None = field(default_factory=RainLayerConfig)
    streaks: SingleStreaksConfig | None = field(default_factory=SingleStreaksConfig)
    enhanced: EnhancedTargetConfig | None = field(default_factory=EnhancedTargetConfig)


class Seen(NamedTuple):
    """A view seen through the rain, and what `backward` and `update` need of it."""

    image: Image  # O [H, W, 3]: through all of the rain
    without_drops: Image  # T [H, W, 3]: through falling rain and mist
    rained: Image  # R [H, W, 3]: through falling rain alone
    scene_image: Image  # B [H, W, 3]
    rain_alpha: Plane | None  # [H, W]; None where there is no rain
    single: bool  # whether the view's single streaks are part of rain_alpha
    mist_root: Plane | None  # sqrt(mist_alpha) [H, W]; None where no mist is looked for yet
    drops: DropLayer | None
    weights: Plane | None  # factors [H, W] on pixels' shares of the loss: 0 where drops hide the scene; None: all 1
    view: int
    iteration: int


class RainModel:
    """Mist, drops, the rain layer and single streaks of one scene's training views."""

    def __init__(
        self,
        images: TrainingImages,
        iterations: int,
        config: RainConfig,
        prior: EnhancedViews | None = None,
        points: Callable[[], PointColours] | None = None,
        covers: EnhancedViews | None = None,
    ) -> None:
        """A model that knows nothing of the rain yet.

        Args:
            images: the training photographs, in order of name.
            iterations: of the training.
            config: which kinds of rain are looked for.
            prior: the photographs without rain as far as a network sees it, asked whether there is mist, and where rain
                may be what is behind it and what are single streaks.
            points: looks up scene points in the photographs, to tell mist on the lens from fog in the scene.
            covers: what drops cover of the photographs, as a network sees it.
        """
        warm_up()
        self.config, self.iterations, self._prior = config, iterations, prior
        count = len(images)
        pictures = [images.pixels(view) for view in range(count)]
        hidden = [images.ignored(view) for view in range(count)]
        sizes = [(picture.shape[0], picture.shape[1]) for picture in pictures]
        self.mist = Mist(pictures, iterations, config.mist, hidden, points, prior) if config.mist else None
        self.enhanced = None
        if config.mist and self.mist and self.mist.wanted and config.enhanced and prior is not None:
            self.enhanced = EnhancedTarget(images, prior, iterations, config.mist, config.enhanced)
        layer, streaks = config.rain_layer, config.streaks
        self.rain = FallingRain(sizes, iterations, layer, streaks, prior) if layer else None
        self.drops = DropsByShape(pictures, iterations, config.drops, hidden) if config.drops else None
        told = covers if covers is not None and covers.tells_cover else None
        self.staying, self.renewed = None, None
        if told and self.drops and config.staying:
            self.staying = StayingDrops(told, count, self.drops.staying, iterations, config.staying)
        if self.drops and self.staying and self.staying.wanted:
            self.drops.believe(self.staying.hidden)
        elif told and config.renewed:
            drops = self.drops or DropsByShape(pictures, iterations, LensDropsConfig(), hidden)
            self.renewed = RenewedDrops(told, images, drops.staying, iterations, config.renewed)
        self.start = None
        if told and self.rain and config.enhanced and not (self.staying and self.staying.asked):
            self.start = EnhancedStart(images, told, iterations, config.enhanced)

    def begin(self, iteration: int) -> None:
        """Call first in every step: estimates single streaks again when that is due."""
        if self.rain:
            self.rain.renew(iteration)

    def forward(self, scene_image: Image, view: int, iteration: int, buffers: BufferPool) -> Seen:
        """A rendered view [H, W, 3], at its own size or a smaller one, through all that is known of the rain.

        Args:
            scene_image: B, finite.
            view: index of the training view.
            iteration: of the training; at the end, its number of iterations.
            buffers: to reuse; what is seen may lie in one of them.
        """
        size = scene_image.shape[0], scene_image.shape[1]
        rain_alpha, single = self.rain.alpha(view, size) if self.rain else (None, False)
        rained = scene_image
        if self.rain and rain_alpha is not None:
            rained = self.rain.layer.forward(scene_image, rain_alpha, buffers.array("rained", scene_image.shape))
        mist_root = self.mist.root(view, size) if self.mist and self.mist.due(iteration) else None
        misted = self._misted(rained, mist_root, buffers.array("misted", scene_image.shape))
        drops = self._drop_layer(view, size, iteration)
        image, weights = (misted, None) if drops is None else drops.forward(misted, buffers)
        return Seen(image, misted, rained, scene_image, rain_alpha, single, mist_root, drops, weights, view, iteration)

    def backward(
        self, seen: Seen, gradient: Image, observed: Observation, buffers: BufferPool
    ) -> tuple[Image, MistGradient | None]:
        """Gradients by the rendered view [H, W, 3], maybe a buffer, and by the mist.

        Args:
            seen: the view.
            gradient: of the loss by `seen.image`.
            observed: its photograph.
            buffers: to reuse.
        """
        by_mist = None
        if seen.drops is not None:
            gradient = seen.drops.backward(gradient, buffers)
        if self.mist and seen.mist_root is not None:
            told = gradient
            if seen.rain_alpha is not None and self.mist.sure_in_rain:
                weights = product(observed.weights, None if seen.drops is None else 1 - seen.drops.alpha)
                told = difference_gradient(seen.image, observed.photograph, weights)
            gradient, by_mist = self.mist.backward(
                seen.rained, seen.without_drops, seen.mist_root, seen.view, gradient, told, buffers
            )
        if self.rain and seen.rain_alpha is not None:
            by_rained = buffers.array("g_rained", gradient.shape)
            gradient = self.rain.layer.backward(gradient, seen.rain_alpha, by_rained)
        return gradient, by_mist

    def update(self, seen: Seen, observed: Observation, by_mist: MistGradient | None, buffers: BufferPool) -> None:
        """Learn of the rain from a view: mist by its gradient, all else from photograph and render."""
        if self.drops and self.drops.due(seen.iteration):
            self.drops.update(observed.photograph, seen.without_drops, seen.view, observed.shown)
        size = seen.image.shape[0], seen.image.shape[1]
        if self.rain and self.rain.due(seen.view, size, seen.iteration):
            even = self._behind_even_rain(self.rain, seen, buffers)
            self.rain.update(observed, even, seen.view, seen.iteration)
        if self.mist and by_mist is not None:
            self.mist.update(by_mist, seen.iteration)

    def enhanced_target(self, view: int, size: tuple[int, int], iteration: int) -> Target | None:
        """The enhanced photograph that the scene is compared with in this step instead of learning of the rain, if any.

        Steps in which falling rain is to be learned have the photograph, and behind mist those for drops as well.
        """
        if self.rain and self.rain.due(view, size, iteration):
            return None
        if self.start and self.start.due(iteration):
            return self.start.target(view, size)
        if self.enhanced is None or self.mist is None or (self.drops and self.drops.due(iteration)):
            return None
        behind_mist = self.mist.due(iteration) and self.enhanced.due(iteration)
        return self.enhanced.target(view, size) if behind_mist else None

    def drop_weights(self, render: Callable[[], Image], target: Target, view: int, iteration: int) -> Plane | None:
        """Factors [H, W] on pixels' shares of the loss, less where a network sees a drop; None: all 1.

        Of drops that stay, or else of those that this view alone shows.

        Args:
            render: gives the view [H, W, 3] as it is seen through the rest of the rain.
            target: the photograph.
            view: index of the training view.
            iteration: of the training.
        """
        if self.staying and self.staying.due(iteration):
            return 1 - self.staying.cover(view, (target.image.shape[0], target.image.shape[1]))
        if self.renewed and self.renewed.due(iteration):
            return self.renewed.weights(target, render(), view)
        return None

    @property
    def even_alpha(self) -> float:
        """S, the median rain_alpha, 0 to 1."""
        return self.rain.even_alpha if self.rain else 0.0

    def rain_alpha(self, view: int, size: tuple[int, int]) -> Plane:
        """rain_alpha [H, W] of a training view at (height, width)."""
        alpha, _ = self.rain.alpha(view, size) if self.rain else (None, False)
        return np.zeros(size, np.float32) if alpha is None else alpha

    def mist_alpha(self, view: int, size: tuple[int, int]) -> Plane:
        """mist_alpha [H, W] of a training view at (height, width); 0 where no mist is looked for."""
        return self.mist.alpha(view, size) if self.mist else np.zeros(size, np.float32)

    def drop_alpha(self, view: int, size: tuple[int, int]) -> Plane:
        """drop_alpha [H, W] of a training view at (height, width), at the end of the training."""
        drops = self._drop_layer(view, size, self.iterations)
        return np.zeros(size, np.float32) if drops is None else drops.alpha

    def seen_cover(self, view: int, size: tuple[int, int]) -> Plane:
        """What drops cover of each pixel [H, W] of a training view at (height, width) on a network's word alone.

        Those that are new in every view, or those that stay, if its word on these counts to the end.
        """
        if self.staying and self.staying.due(self.iterations - 1):
            return self.staying.cover(view, size)
        return self.renewed.cover(view, size) if self.renewed else np.zeros(size, np.float32)

    def settings(self) -> dict[str, Any]:
        """The settings; a checkpoint made with others is refused."""
        return {"rain": asdict(self.config), "prior": self._prior.digest if self._prior else None}

    def state_dict(self) -> dict[str, NDArray]:
        """What has been learned of the rain, for checkpoints."""
        arrays: dict[str, NDArray] = {}
        for part, model in self._parts():
            arrays |= prefixed(part, model.state_dict())
        return arrays

    def load_state_dict(self, arrays: dict[str, NDArray]) -> None:
        """Take back what `state_dict` returned."""
        for part, model in self._parts():
            model.load_state_dict(below(part, arrays))

    def _parts(self) -> list[tuple[str, Any]]:
        parts = ("mist", self.mist), ("drops", self.drops), *(self.rain.parts() if self.rain else ())
        return [(name, model) for name, model in parts if model is not None]

    def _misted(self, image: Image, root: Plane | None, out: Image) -> Image:
        return image if self.mist is None or root is None else self.mist.forward(image, root, out)

    def _drop_layer(self, view: int, size: tuple[int, int], iteration: int) -> DropLayer | None:
        return self.drops.layer(view, size, iteration) if self.drops else None

    def _behind_even_rain(self, rain: FallingRain, seen: Seen, buffers: BufferPool) -> Image:
        """The view [H, W, 3] without its single streaks and without drops."""
        if not seen.single:
            return seen.without_drops
        even = np.full(seen.image.shape[:2], rain.even_alpha, np.float32)
        rained = rain.layer.forward(seen.scene_image, even, buffers.array("rained_even", seen.image.shape))
        return self._misted(rained, seen.mist_root, buffers.array("misted_even", rained.shape))
