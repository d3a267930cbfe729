"""What DeRainGS compares its renders with the photographs by: the photometric loss, seen through a model of the rain.

    seen = lens veil over (falling rain over the rendered scene);  loss = photometric(seen, photograph; weights)

`rain_lens` has the veil of mist, `rain_falling` what falling rain covers evenly, `rain_streaks` how much more or less
that is in every pixel of a view, `rain_drops` the weights behind drops. All are learned while the scene is, and each
switches itself on only where the photographs call for it; `found` says what was.
"""

from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from baselines.splatting.loss_map import loss_map
from baselines.splatting.objective import Objective, TrainingImages
from baselines.splatting.photometric import Target, photometric_loss
from baselines.splatting.rasterizer import Workspace
from deraings.enhanced import EnhancedViews
from deraings.masking import OcclusionMasks
from deraings.planes import Plane
from deraings.rain_drops import DropConfig, Drops, Spread
from deraings.rain_falling import FallingConfig, FallingRain
from deraings.rain_lens import Veil, VeilConfig
from deraings.rain_streaks import StreakConfig, Streaks, along_rain, cover_between
from hydroviews.images import Image


@dataclass(frozen=True)
class RainConfig:
    """Which kinds of rain are looked for; None leaves one out."""

    veil: VeilConfig | None = field(default_factory=VeilConfig)
    drops: DropConfig | None = field(default_factory=DropConfig)
    falling: FallingConfig | None = field(default_factory=FallingConfig)
    streaks: StreakConfig | None = field(default_factory=StreakConfig)  # where falling rain is looked for


THIN = 0.004  # cover by falling rain that is as good as none


class RainObjective(Objective):
    """The photometric loss of the scene as it is seen through the rain."""

    def __init__(
        self,
        images: TrainingImages,
        iterations: int,
        config: RainConfig | None = None,
        ssim_share: float = 0.2,
        masks: OcclusionMasks | None = None,
        derained: EnhancedViews | None = None,
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
        """
        super().__init__(images, ssim_share)
        self.config = config = config or RainConfig()
        self.masks, self.derained, self._iterations = masks, derained, iterations
        count = len(images)
        pictures = [images.pixels(view) for view in range(count)]
        hidden = [images.ignored(view) for view in range(count)]
        self.veil = Veil(pictures, iterations, config.veil, hidden) if config.veil else None
        self.falling = FallingRain(iterations, config.falling) if config.falling else None
        sizes = [(picture.shape[0], picture.shape[1]) for picture in pictures]
        self.streaks = Streaks(sizes, config.streaks) if config.falling and config.streaks else None
        renewed = config.streaks.renewed if config.streaks else ()
        self._renewals = {round(share * iterations) for share in renewed}
        self.drops = Drops(Spread(pictures, config.drops), count, iterations, config.drops) if config.drops else None

    def __call__(self, image: Image, view: int, iteration: int, workspace: Workspace) -> tuple[float, Image]:
        """See Objective; learns of the rain as well."""
        if self.streaks and iteration in self._renewals:
            self.streaks.renew()
        target = self.images.target(view, (image.shape[0], image.shape[1]))
        finite = _finite(image)
        image = image if finite is None else np.where(finite[..., None], image, np.float32(0))
        cover = self._cover(view, (image.shape[0], image.shape[1]))
        even = self._behind_even_rain(image, cover, view, iteration, workspace)
        seen, behind = self._seen(image, cover, view, iteration, workspace)
        if self.masks and self.masks.due(iteration):
            self.masks.learn(view, loss_map(seen, target, self.ssim_share, workspace=workspace), iteration)
        weights = self._weights(target, finite, view, iteration)
        self._observe(seen, seen if even is None else even, target, weights, view, iteration)
        loss, gradient = photometric_loss(seen, target, self.ssim_share, weights, workspace)
        if self.veil and self.veil.due(iteration):
            gradient = self.veil.learn(behind, view, gradient, iteration, workspace)
        return loss, gradient * (1 - cover)

    def residual(self, image: Image, view: int, workspace: Workspace) -> float:
        """See Objective."""
        cover = self._cover(view, (image.shape[0], image.shape[1]))
        seen, _ = self._seen(image, cover, view, self._iterations, workspace)
        return photometric_loss(seen, self.images.target(view), self.ssim_share, workspace=workspace)[0]

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

    def _behind_even_rain(
        self, image: Image, cover: NDArray[np.float32], view: int, iteration: int, workspace: Workspace
    ) -> Image | None:
        """The view without its single streaks, to learn of the rain; None where none are known, or nobody looks."""
        looked = self.falling and (self.falling.due(iteration) or self._streaks_due(view, image))
        if not looked or cover.ndim == 0:
            return None
        return self._seen(image, np.asarray(self.cover, np.float32), view, iteration, workspace)[0].copy()

    def _streaks_due(self, view: int, image: Image) -> bool:
        return bool(self.streaks and self.cover > THIN and self.streaks.due(view, (image.shape[0], image.shape[1])))

    def _seen(
        self, image: Image, cover: NDArray[np.float32], view: int, iteration: int, workspace: Workspace
    ) -> tuple[Image, Image]:
        """The scene through all the rain, and through the falling rain alone."""
        if self.falling and cover.any():
            image = image * (1 - cover) + cover * np.float32(self.falling.brightness)
        if self.veil and self.veil.due(iteration):
            return self.veil.apply(image, view, workspace), image
        return image, image

    def _weights(self, target: Target, finite: NDArray | None, view: int, iteration: int) -> Plane | None:
        """Factors on each pixel's share of the loss [H, W]; None where all are 1. What is hidden counts for nothing."""
        size = target.pixels.shape[0], target.pixels.shape[1] // 3
        parts = [
            self.drops.weights(view, size, iteration) if self.drops else None,
            self.masks.weights(view, size, iteration) if self.masks else None,
            None if finite is None else finite.astype(np.float32),
            target.shown,
        ]
        weights = None
        for part in parts:
            if part is not None:
                weights = part if weights is None else weights * part
        return weights

    def _observe(
        self, seen: Image, even: Image, target: Target, weights: Plane | None, view: int, iteration: int
    ) -> None:
        """Learn of the rain from what is seen, and from what is seen without single streaks."""
        photograph = target.pixels.reshape(seen.shape)
        if self.drops:
            difference = photograph - seen
            self.drops.observe(difference if target.shown is None else difference * target.shown[..., None], view)
        if not self.falling:
            return
        if self.streaks and self._streaks_due(view, seen) and self.falling.certainty() == 1:
            along, contrast = along_rain(photograph, even, self.cover, self.falling.brightness)
            clear = np.float32(1) if weights is None else weights
            self.streaks.observe(
                along * clear, contrast * clear, self.falling.angle(), view, self._witness(photograph, view)
            )
        if self.falling.due(iteration):
            self.falling.observe(photograph, even, weights, iteration)

    def _witness(self, photograph: Image, view: int) -> Plane | None:
        """What the network takes for rain of a view [H, W] beyond the median, which is told to `falling`."""
        if self.derained is None or self.falling is None:
            return None
        dry = self.derained.pixels(view).astype(np.float32) / 255
        cover = cover_between(photograph, dry, self.falling.brightness)
        median = np.median(cover)
        self.falling.hear(float(median))
        return cover - median

    def veil_share(self, view: int, size: tuple[int, int]) -> Plane:
        """V [H, W] of a training view; nought where no veil is looked for."""
        return self.veil.share(view, size) if self.veil else np.zeros(size, np.float32)

    def falling_share(self, view: int, size: tuple[int, int]) -> Plane:
        """S + D [H, W] of a training view: its cover by falling rain."""
        cover = self._cover(view, size)
        return np.array(np.broadcast_to(cover if cover.ndim == 0 else cover[..., 0], size))

    def drop_weights(self, view: int, size: tuple[int, int]) -> Plane:
        """Weights [H, W] of a training view at the end: 0 behind drops, else 1."""
        weights = self.drops.weights(view, size, self.drops.iterations) if self.drops else None
        return np.ones(size, np.float32) if weights is None else weights

    def found(self) -> dict[str, Any]:
        """What rain was found, for the record, at the middle of the film.

        Returns:
            `needed`: which of veil, drops, falling, streaks and masks were called for; then means and maxima of what
            they are. A part that is not looked for is left out.
        """
        middle = len(self.images) // 2
        size = self.images.pixels(middle).shape[0], self.images.pixels(middle).shape[1]
        report: dict[str, Any] = {}
        if self.veil:
            share = self.veil_share(middle, size)
            report |= {"veil_mean": share.mean(), "veil_most": share.max()}
            report |= {f"veil_{channel}": light for channel, light in zip("rgb", self.veil.colour, strict=True)}
        if self.drops:
            report["drops"] = (self.drop_weights(middle, size) < 0.5).mean()
        if self.falling:
            report |= {"falling": self.cover, "falling_certainty": self.falling.certainty()}
            report["falling_angle"] = self.falling.angle()
        if self.streaks:
            report["streaks"] = np.abs(self.streaks.deviation(middle)).mean()
        if self.masks:
            report["masks"] = self.masks.found()["mask_mean"]
        limits = {"veil_mean": 0.0, "drops": 0.0, "falling": THIN, "streaks": 0.0, "masks": 0.0}
        numbers = {name: round(float(value), 4) for name, value in report.items()}
        needed = [name.removesuffix("_mean") for name, limit in limits.items() if numbers.get(name, 0) > limit]
        return {"needed": needed, **numbers}

    def about(self) -> dict[str, Any]:
        """See Objective."""
        masks = self.masks.about() if self.masks else None
        witness = self.derained.digest if self.derained else None
        return {**super().about(), "rain": asdict(self.config), "masks": masks, "witness": witness}

    def arrays(self) -> dict[str, NDArray]:
        """See Objective."""
        return {f"{part}.{name}": value for part, model in self._parts() for name, value in model.arrays().items()}

    def restore(self, arrays: dict[str, NDArray]) -> None:
        """See Objective."""
        for part, model in self._parts():
            start = f"{part}."
            model.restore({name[len(start) :]: value for name, value in arrays.items() if name.startswith(start)})

    def _parts(self) -> list[tuple[str, Any]]:
        parts = (
            ("veil", self.veil),
            ("drops", self.drops),
            ("falling", self.falling),
            ("streaks", self.streaks),
            ("masks", self.masks),
        )
        return [(name, model) for name, model in parts if model is not None]


def _finite(image: Image) -> NDArray[np.bool_] | None:
    """Which pixels [H, W] of a render are finite; None where all are."""
    if np.isfinite(image.sum(dtype=np.float64)):
        return None
    return np.asarray(np.isfinite(image).all(axis=2))
