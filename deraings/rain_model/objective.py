"""What DeRainGS compares its renders with the photographs by: the photometric loss, seen through a model of the rain.

    seen = drops over (lens veil over (falling rain over the rendered scene))
    loss = photometric(seen, photograph; weights)

`rain_lens` has the veil of mist, `rain_falling` what falling rain covers evenly, `rain_streaks` how much more or less
that is in every pixel of a view, `rain_drops` the drops on the lens. All are learned while the scene is, and each
switches itself on only where the photographs call for it; `rain_found` says what was.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.kernels.loss_map import loss_map
from baselines.splatting.kernels.photometric import Target, photometric_loss
from baselines.splatting.objective import Objective
from baselines.training.images import TrainingImages
from deraings.enhancement.views import EnhancedViews
from deraings.masks.occlusion_masks import OcclusionMasks
from deraings.planes import Plane
from deraings.rain_model.drops import DropConfig, Drops, Water
from deraings.rain_model.mist import Veil, VeilConfig
from deraings.rain_model.rain_layer import THIN, FallingConfig, FallingRain
from deraings.rain_model.streaks import StreakConfig, Streaks, along_rain, cover_between
from hydroviews.scene.images import Image
from hydroviews.scene.point_colours import PointColours


@dataclass(frozen=True)
class RainConfig:
    """Which kinds of rain are looked for; None leaves one out."""

    veil: VeilConfig | None = field(default_factory=VeilConfig)
    drops: DropConfig | None = field(default_factory=DropConfig)
    falling: FallingConfig | None = field(default_factory=FallingConfig)
    streaks: StreakConfig | None = field(default_factory=StreakConfig)  # where falling rain is looked for


class RainObjective(Objective):
    """The photometric loss of the scene as it is seen through the rain."""

    def __init__(
        self,
        images: TrainingImages,
        iterations: int,
        config: RainConfig | None = None,
        lambda_dssim: float = 0.2,
        masks: OcclusionMasks | None = None,
        derained: EnhancedViews | None = None,
        points: Callable[[], PointColours] | None = None,
    ) -> None:
        """A model of the rain, before anything is known of it.

        Args:
            images: the training photographs, in order of name.
            iterations: of the training.
            config: which kinds of rain are looked for.
            ssim_share: lambda of the photometric loss.
            masks: occlusion masks to be learned as well; what the rain model explains is not for them to mask.
            derained: the photographs without rain as far as a network sees it, a witness where single streaks are
                looked for; asked for only if it surely rains.
            points: looks up scene points in the photographs, to tell mist on the lens from fog in the scene.
        """
        super().__init__(images, lambda_dssim)
        self.config = config = config or RainConfig()
        self.masks, self.derained, self._iterations = masks, derained, iterations
        count = len(images)
        pictures = [images.pixels(view) for view in range(count)]
        hidden = [images.ignored(view) for view in range(count)]
        self.veil = Veil(pictures, iterations, config.veil, hidden, points) if config.veil else None
        self.falling = FallingRain(iterations, config.falling) if config.falling else None
        sizes = [(picture.shape[0], picture.shape[1]) for picture in pictures]
        self.streaks = Streaks(sizes, config.streaks) if config.falling and config.streaks else None
        renewed = config.streaks.renewed if config.streaks else ()
        self._renewals = {round(share * iterations) for share in renewed}
        self.drops = Drops(sizes[0], count, iterations, config.drops) if config.drops else None

    def __call__(self, image: Image, view: int, iteration: int, buffers: BufferPool) -> tuple[float, Image]:
        """See Objective; learns of the rain as well."""
        if self.streaks and iteration in self._renewals:
            self.streaks.renew()
        target = self.target(view, (image.shape[0], image.shape[1]))
        finite = _finite(image)
        image = image if finite is None else np.where(finite[..., None], image, np.float32(0))
        size = image.shape[0], image.shape[1]
        cover, water = self._cover(view, size), self._water(view, size, iteration)
        even = self._behind_even_rain(image, cover, view, iteration, buffers)
        clear, behind = self._seen(image, cover, view, iteration, buffers)
        seen = clear if water is None else water.over(clear)
        if self.masks and self.masks.due(iteration):
            self.masks.learn(view, loss_map(seen, target, self.lambda_dssim, buffers=buffers), iteration)
        shown = _product(target.shown, None if finite is None else finite.astype(np.float32))
        weights = self._weights(shown, size, water, view, iteration)
        self._observe(clear, clear if even is None else even, target, shown, weights, view, iteration)
        loss, gradient = photometric_loss(seen, target, self.lambda_dssim, weights, buffers)
        if water is not None:
            gradient = gradient * (1 - water.cover)[..., None]
        if self.veil and self.veil.due(iteration):
            gradient = self.veil.learn(behind, view, gradient, iteration, buffers)
        return loss, gradient * (1 - cover)

    def residual(self, image: Image, view: int, buffers: BufferPool) -> float:
        """See Objective."""
        size = image.shape[0], image.shape[1]
        water = self._water(view, size, self._iterations)
        seen, _ = self._seen(image, self._cover(view, size), view, self._iterations, buffers)
        seen = seen if water is None else water.over(seen)
        return photometric_loss(seen, self.target(view), self.lambda_dssim, buffers=buffers)[0]

    @property
    def cover(self) -> float:
        """Median cover by falling rain, 0 to 1."""
        return float(self.falling.cover[0]) if self.falling else 0.0

    def _cover(self, view: int, size: tuple[int, int]) -> NDArray[np.float32]:
        """Cover by falling rain: one number, or [H, W, 1] where a view's single streaks are known."""
        if self.streaks and self.cover > THIN:
            cover = self.streaks.cover(view, self.cover, size)
            if cover is not None:
                return cover[..., None]
        return np.asarray(self.cover, np.float32)

    def _water(self, view: int, size: tuple[int, int], iteration: int) -> Water | None:
        """The drops on the lens; None where there are none, or nobody looks."""
        return self.drops.water(view, size, iteration) if self.drops else None

    def _behind_even_rain(
        self, image: Image, cover: NDArray[np.float32], view: int, iteration: int, buffers: BufferPool
    ) -> Image | None:
        """The view without its single streaks, to learn of the rain; None where none are known, or nobody looks."""
        looked = self.falling and (self.falling.due(iteration) or self._streaks_due(view, image))
        if not looked or cover.ndim == 0:
            return None
        return self._seen(image, np.asarray(self.cover, np.float32), view, iteration, buffers)[0].copy()

    def _streaks_due(self, view: int, image: Image) -> bool:
        return bool(self.streaks and self.cover > THIN and self.streaks.due(view, (image.shape[0], image.shape[1])))

    def _seen(
        self, image: Image, cover: NDArray[np.float32], view: int, iteration: int, buffers: BufferPool
    ) -> tuple[Image, Image]:
        """The scene through all the rain but drops, and through the falling rain alone."""
        if self.falling and cover.any():
            image = image * (1 - cover) + cover * np.float32(self.falling.brightness)
        if self.veil and self.veil.due(iteration):
            return self.veil.apply(image, view, buffers), image
        return image, image

    def _weights(
        self, shown: Plane | None, size: tuple[int, int], water: Water | None, view: int, iteration: int
    ) -> Plane | None:
        """Factors on each pixel's share of the loss [H, W]; None where all are 1. What is hidden counts for nothing."""
        masks = self.masks.weights(view, size, iteration) if self.masks else None
        return _product(None if water is None else water.weights, masks, shown)

    def _observe(
        self,
        clear: Image,
        even: Image,
        target: Target,
        shown: Plane | None,
        weights: Plane | None,
        view: int,
        iteration: int,
    ) -> None:
        """Learn of the rain from what is seen but for drops, and from what is seen without single streaks as well."""
        photograph = target.pixels.reshape(clear.shape)
        if self.drops:
            self.drops.observe(photograph, clear, view, shown)
        if not self.falling:
            return
        if self.streaks and self._streaks_due(view, clear) and self.falling.certainty() == 1:
            along, contrast = along_rain(photograph, even, self.cover, self.falling.brightness)
            factor = np.float32(1) if weights is None else weights
            witness = self._witness(photograph, target.shown, view)
            self.streaks.observe(along * factor, contrast * factor, self.falling.angle(), view, witness)
        if self.falling.due(iteration):
            self.falling.observe(photograph, even, weights, iteration)

    def _witness(self, photograph: Image, shown: Plane | None, view: int) -> Plane | None:
        """What the network takes for rain of a view [H, W] beyond the median, which is told to `falling`.

        Nought where the photograph is hidden; None where all of it is, or there is no witness.
        """
        if self.derained is None or self.falling is None or (shown is not None and not shown.any()):
            return None
        dry = self.derained.pixels(view).astype(np.float32) / 255
        cover = cover_between(photograph, dry, self.falling.brightness)
        median = np.median(cover if shown is None else cover[shown > 0])
        self.falling.hear(float(median))
        return cover - median if shown is None else (cover - median) * shown

    def veil_share(self, view: int, size: tuple[int, int]) -> Plane:
        """V [H, W] of a training view; nought where no veil is looked for."""
        return self.veil.share(view, size) if self.veil else np.zeros(size, np.float32)

    def falling_share(self, view: int, size: tuple[int, int]) -> Plane:
        """S + D [H, W] of a training view: its cover by falling rain."""
        cover = self._cover(view, size)
        return np.array(np.broadcast_to(cover if cover.ndim == 0 else cover[..., 0], size))

    def drop_cover(self, view: int, size: tuple[int, int]) -> Plane:
        """M [H, W] of a training view at the end: its cover by drops."""
        water = self._water(view, size, self._iterations)
        return np.zeros(size, np.float32) if water is None else water.cover

    def settings(self) -> dict[str, Any]:
        """See Objective."""
        masks = self.masks.settings() if self.masks else None
        witness = self.derained.digest if self.derained else None
        return {**super().settings(), "rain": asdict(self.config), "masks": masks, "witness": witness}

    def state_dict(self) -> dict[str, NDArray]:
        """See Objective."""
        return {f"{part}.{name}": value for part, model in self._parts() for name, value in model.state_dict().items()}

    def load_state_dict(self, arrays: dict[str, NDArray]) -> None:
        """See Objective."""
        for part, model in self._parts():
            start = f"{part}."
            model.load_state_dict(
                {name[len(start) :]: value for name, value in arrays.items() if name.startswith(start)}
            )

    def _parts(self) -> list[tuple[str, Any]]:
        parts = (
            ("veil", self.veil),
            ("drops", self.drops),
            ("falling", self.falling),
            ("streaks", self.streaks),
            ("masks", self.masks),
        )
        return [(name, model) for name, model in parts if model is not None]


def _product(*parts: Plane | None) -> Plane | None:
    """The product of planes [H, W]; None stands for one that is 1 everywhere."""
    product = None
    for part in parts:
        if part is not None:
            product = part if product is None else product * part
    return product


def _finite(image: Image) -> NDArray[np.bool_] | None:
    """Which pixels [H, W] of a render are finite; None where all are."""
    if np.isfinite(image.sum(dtype=np.float64)):
        return None
    return np.asarray(np.isfinite(image).all(axis=2))
