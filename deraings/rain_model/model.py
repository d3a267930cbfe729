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
from baselines.training.checkpoints import below
from baselines.training.images import TrainingImages
from deraings.enhancement.views import EnhancedViews
from deraings.image_planes import Plane
from deraings.rain_model.drops import DropLayer, LensDrops, LensDropsConfig
from deraings.rain_model.mist import Mist, MistConfig, MistGradient
from deraings.rain_model.rain_layer import MIN_ALPHA, RainLayer, RainLayerConfig, alpha_between
from deraings.rain_model.streaks import SingleStreaks, SingleStreaksConfig, along_rain
from deraings.rain_model.warm_up import warm_up
from hydroviews.scene.images import Image
from hydroviews.scene.point_colours import PointColours


@dataclass(frozen=True)
class RainConfig:
    """Which kinds of rain are looked for; None leaves one out.

    Attributes:
        mist: on the lens.
        drops: on the lens.
        rain_layer: falling rain, even.
        streaks: single ones, looked for only where falling rain is.
    """

    mist: MistConfig | None = field(default_factory=MistConfig)
    drops: LensDropsConfig | None = field(default_factory=LensDropsConfig)
    rain_layer: RainLayerConfig | None = field(default_factory=RainLayerConfig)
    streaks: SingleStreaksConfig | None = field(default_factory=SingleStreaksConfig)


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


class Observation(NamedTuple):
    """A training photograph, and which of its pixels count."""

    photograph: Image  # [H, W, 3]
    photographed: Plane | None  # [H, W], 0 where the photograph's mask hides it; None where nothing is hidden
    shown: Plane | None  # [H, W], the same, and 0 where the render is not finite
    weights: Plane | None  # [H, W] factors on each pixel's share of the loss; None where all are 1


class RainModel:
    """Mist, drops, the rain layer and single streaks of one scene's training views."""

    def __init__(
        self,
        images: TrainingImages,
        iterations: int,
        config: RainConfig,
        prior: EnhancedViews | None = None,
        points: Callable[[], PointColours] | None = None,
    ) -> None:
        """A model that knows nothing of the rain yet.

        Args:
            images: the training photographs, in order of name.
            iterations: of the training.
            config: which kinds of rain are looked for.
            prior: the photographs without rain as far as a network sees it, for single streaks; asked only once it
                surely rains.
            points: looks up scene points in the photographs, to tell mist on the lens from fog in the scene.
        """
        warm_up()
        self.config, self.iterations, self._prior = config, iterations, prior
        count = len(images)
        pictures = [images.pixels(view) for view in range(count)]
        hidden = [images.ignored(view) for view in range(count)]
        self._sizes = sizes = [(picture.shape[0], picture.shape[1]) for picture in pictures]
        self.mist = Mist(pictures, iterations, config.mist, hidden, points) if config.mist else None
        self.rain_layer = RainLayer(iterations, config.rain_layer) if config.rain_layer else None
        self.streaks = SingleStreaks(sizes, config.streaks) if config.rain_layer and config.streaks else None
        renewals = config.streaks.renewals if config.streaks else ()
        self._renewals = {round(share * iterations) for share in renewals}
        self.drops = LensDrops(pictures, iterations, config.drops, hidden) if config.drops else None

    def forward(self, scene_image: Image, view: int, iteration: int, buffers: BufferPool) -> Seen:
        """A rendered view [H, W, 3], at its own size or a smaller one, through all that is known of the rain.

        Args:
            scene_image: B, finite.
            view: index of the training view.
            iteration: of the training; at the end, its number of iterations.
            buffers: to reuse; what is seen may lie in one of them.
        """
        size = scene_image.shape[0], scene_image.shape[1]
        rain_alpha, single = self._rain_alpha(view, size)
        rained = self._rained(scene_image, rain_alpha, buffers.array("rained", scene_image.shape))
        mist_root = self.mist.root(view, size) if self.mist and self.mist.due(iteration) else None
        misted = self._misted(rained, mist_root, buffers.array("misted", scene_image.shape))
        drops = self._drop_layer(view, size, iteration)
        image, weights = (misted, None) if drops is None else drops.forward(misted, buffers)
        return Seen(image, misted, rained, scene_image, rain_alpha, single, mist_root, drops, weights, view, iteration)

    def backward(self, seen: Seen, gradient: Image, buffers: BufferPool) -> tuple[Image, MistGradient | None]:
        """From the gradient by `seen.image`: those by the rendered view [H, W, 3], maybe a buffer, and by the mist."""
        by_mist = None
        if seen.drops is not None:
            gradient = seen.drops.backward(gradient, buffers)
        if self.mist and seen.mist_root is not None:
            gradient, by_mist = self.mist.backward(
                seen.rained, seen.without_drops, seen.mist_root, seen.view, gradient, buffers
            )
        if self.rain_layer and seen.rain_alpha is not None:
            by_rained = buffers.array("g_rained", gradient.shape)
            gradient = self.rain_layer.backward(gradient, seen.rain_alpha, by_rained)
        return gradient, by_mist

    def update(self, seen: Seen, observed: Observation, by_mist: MistGradient | None, buffers: BufferPool) -> None:
        """Learn of the rain from a view: mist by its gradient, all else from photograph and render."""
        if self.streaks and seen.iteration in self._renewals:
            self.streaks.renew()
        if self.drops and self.drops.due(seen.iteration):
            self.drops.update(observed.photograph, seen.without_drops, seen.view, observed.shown)
        if self.rain_layer:
            self._update_rain(self.rain_layer, seen, observed, buffers)
        if self.mist and by_mist is not None:
            self.mist.update(by_mist, seen.iteration)

    @property
    def even_alpha(self) -> float:
        """S, the median rain_alpha, 0 to 1."""
        return float(self.rain_layer.alpha[0]) if self.rain_layer else 0.0

    def rain_alpha(self, view: int, size: tuple[int, int]) -> Plane:
        """rain_alpha [H, W] of a training view at (height, width)."""
        alpha, _ = self._rain_alpha(view, size)
        return np.zeros(size, np.float32) if alpha is None else alpha

    def mist_alpha(self, view: int, size: tuple[int, int]) -> Plane:
        """mist_alpha [H, W] of a training view at (height, width); 0 where no mist is looked for."""
        return self.mist.alpha(view, size) if self.mist else np.zeros(size, np.float32)

    def drop_alpha(self, view: int, size: tuple[int, int]) -> Plane:
        """drop_alpha [H, W] of a training view at (height, width), at the end of the training."""
        drops = self._drop_layer(view, size, self.iterations)
        return np.zeros(size, np.float32) if drops is None else drops.alpha

    def settings(self) -> dict[str, Any]:
        """The settings; a checkpoint made with others is refused."""
        return {"rain": asdict(self.config), "prior": self._prior.digest if self._prior else None}

    def state_dict(self) -> dict[str, NDArray]:
        """What has been learned of the rain, for checkpoints."""
        return {f"{part}.{name}": value for part, model in self._parts() for name, value in model.state_dict().items()}

    def load_state_dict(self, arrays: dict[str, NDArray]) -> None:
        """Take back what `state_dict` returned."""
        for part, model in self._parts():
            model.load_state_dict(below(part, arrays))

    def _parts(self) -> list[tuple[str, Any]]:
        parts = ("mist", self.mist), ("drops", self.drops), ("rain_layer", self.rain_layer), ("streaks", self.streaks)
        return [(name, model) for name, model in parts if model is not None]

    def _rain_alpha(self, view: int, size: tuple[int, int]) -> tuple[Plane | None, bool]:
        """rain_alpha [H, W], None where there is none, and whether a view's single streaks are part of it."""
        if self.streaks and self.even_alpha > MIN_ALPHA:
            alpha = self.streaks.alpha(view, self.even_alpha, size)
            if alpha is not None:
                return alpha, True
        return (np.full(size, self.even_alpha, np.float32) if self.even_alpha else None), False

    def _rained(self, image: Image, alpha: Plane | None, out: Image) -> Image:
        return image if self.rain_layer is None or alpha is None else self.rain_layer.forward(image, alpha, out)

    def _misted(self, image: Image, root: Plane | None, out: Image) -> Image:
        return image if self.mist is None or root is None else self.mist.forward(image, root, out)

    def _drop_layer(self, view: int, size: tuple[int, int], iteration: int) -> DropLayer | None:
        return self.drops.layer(view, size, iteration) if self.drops else None

    def _update_rain(self, layer: RainLayer, seen: Seen, observed: Observation, buffers: BufferPool) -> None:
        """Learn of falling rain from the view behind even rain, without its single streaks."""
        if seen.image.shape[:2] != self._sizes[seen.view]:  # small ones hide streaks
            return
        streaks = self.streaks if self._streaks_due(seen) and layer.certainty() == 1 else None
        due = layer.due(seen.iteration)
        if not due and streaks is None:
            return
        even = self._behind_even_rain(seen, buffers)
        if streaks is not None:
            along, contrast = along_rain(observed.photograph, even, self.even_alpha, layer.brightness)
            if observed.weights is not None:
                along, contrast = along * observed.weights, contrast * observed.weights
            prior = self._prior_deviation(layer, observed, seen.view)
            streaks.update(along, contrast, layer.angle(), seen.view, prior)
        if due:
            layer.update(observed.photograph, even, observed.weights, seen.iteration)

    def _streaks_due(self, seen: Seen) -> bool:
        size = seen.image.shape[0], seen.image.shape[1]
        return bool(self.streaks and self.even_alpha > MIN_ALPHA and self.streaks.due(seen.view, size))

    def _behind_even_rain(self, seen: Seen, buffers: BufferPool) -> Image:
        """The view [H, W, 3] without its single streaks and without drops."""
        if not seen.single:
            return seen.without_drops
        even = np.full(seen.image.shape[:2], self.even_alpha, np.float32)
        rained = self._rained(seen.scene_image, even, buffers.array("rained_even", seen.image.shape))
        return self._misted(rained, seen.mist_root, buffers.array("misted_even", rained.shape))

    def _prior_deviation(self, layer: RainLayer, observed: Observation, view: int) -> Plane | None:
        """D of a view [H, W] as the prior sees it, whose median goes to the rain layer.

        0 where the photograph is hidden; None where all of it is, or there is no prior.
        """
        shown = observed.photographed
        if self._prior is None or (shown is not None and not shown.any()):
            return None
        alpha = alpha_between(observed.photograph, self._prior.image(view), layer.brightness)
        median = np.median(alpha if shown is None else alpha[shown > 0])
        layer.update_prior(float(median))
        return alpha - median if shown is None else (alpha - median) * shown
