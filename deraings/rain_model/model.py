"""The rain between scene and photograph: falling rain, then mist on the lens, then drops on the lens.

`RainModel.forward` shows a rendered view through the rain, `backward` takes the gradient back through it, and `update`
learns of the rain from a view that has been compared with its photograph.
"""

from collections.abc import Callable
from dataclasses import asdict
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.training.checkpoints import below, prefixed
from baselines.training.images import Size, TrainingImages
from deraings.enhancement.views import EnhancedViews
from deraings.image_planes import Plane, product
from deraings.lens.mist_prior import mist_exists
from deraings.lens.paleness import MistEvidence, mist_evidence
from deraings.rain_model.config import RainConfig
from deraings.rain_model.drops import DropLayer, Drops
from deraings.rain_model.kernels import warm_up
from deraings.rain_model.mist import Mist, MistGradient, difference_gradient
from deraings.rain_model.occlusion import Occlusion
from deraings.rain_model.rainfall import Rainfall
from hydroviews.scene.images import Image

MIST, DROPS = "mist", "drops"
COVERED = 0.5  # drop_alpha of a pixel that counts as covered, in reports


class Observation(NamedTuple):
    """A training photograph, and which of its pixels count."""

    photograph: Image  # [H, W, 3]
    shown: Plane | None  # [H, W], 0 where its mask hides it or the render is not finite; None where all is shown
    weights: Plane | None  # [H, W] factors on each pixel's share of the loss; None where all are 1


class Seen(NamedTuple):
    """A view seen through the rain, and what `backward` and `update` need of it."""

    image: Image  # O [H, W, 3]: through all of the rain
    without_drops: Image  # T [H, W, 3]: through falling rain and mist
    rained: Image  # R [H, W, 3]: through falling rain alone
    rain_alpha: Plane | None  # [H, W]; None where there is no rain
    mist_root: Plane | None  # sqrt(mist_alpha) [H, W]; None where mist does not count
    drops: DropLayer | None
    view: int
    iteration: int


class RainModel:
    """Mist, drops and falling rain of one scene's training views.

    Attributes:
        off: layers on the lens that do not count: no source shows them, or they fail the trial of the objective.
    """

    def __init__(
        self,
        images: TrainingImages,
        iterations: int,
        config: RainConfig,
        network: EnhancedViews | None = None,
        evidence: Callable[[], MistEvidence] | None = None,
        covers: EnhancedViews | None = None,
    ) -> None:
        """A model that has learned nothing of the rain yet.

        Args:
            images: the training photographs, in order of name.
            iterations: of the training.
            config: which kinds of rain are modelled.
            network: the photographs as a network enhances them: evidence of mist and of falling rain.
            evidence: what photographs and scene points show of mist; by default, what photographs alone do.
            covers: what a network predicts that drops cover of the photographs.
        """
        warm_up()
        self.config, self.iterations, self._network = config, iterations, network
        self._first = round(config.start * iterations)  # in which drops count
        pictures = [images.pixels(view) for view in range(len(images))]
        hidden = [images.ignored(view) for view in range(len(images))]
        self.off: set[str] = set()
        self.occlusion, self.mist, self.drops, self.rainfall = None, None, None, None
        if config.occlusion and covers is not None and covers.tells_cover:
            self.occlusion = Occlusion(covers, len(images), config.occlusion)
        if config.mist:
            predicted = network.lens_mist if network else lambda _: None
            shown = evidence() if evidence else mist_evidence(images)
            self.mist = Mist(shown, iterations, config.mist, predicted)
            if not mist_exists(self.mist.prior, self.occlusion is not None and self.occlusion.wet):
                self.off.add(MIST)
        if config.drops:
            mean_cover = self.occlusion.recurring_cover if self.occlusion else None
            self.drops = Drops(pictures, config.drops, hidden, mean_cover)
        if config.rainfall and network and network.tells_cover:
            rainfall = Rainfall(images, network, config.rainfall.brightness)
            self.rainfall = rainfall if rainfall.falls else None

    def counts(self, layer: str, iteration: int) -> bool:
        """Whether views are seen through MIST or DROPS in this step."""
        if layer in self.off:
            return False
        return self.mist is not None if layer == MIST else self.drops is not None and iteration >= self._first

    def forward(
        self, scene_image: Image, view: int, iteration: int, buffers: BufferPool, without: str | None = None
    ) -> Seen:
        """A rendered view [H, W, 3], at its own size or a smaller one, through all that is known of the rain.

        Args:
            scene_image: B, finite.
            view: index of the training view.
            iteration: of the training; at the end, its number of iterations.
            buffers: to reuse; what is seen may lie in one of them.
            without: MIST or DROPS, which is left out.
        """
        size = scene_image.shape[0], scene_image.shape[1]
        rained, rain_alpha = scene_image, None
        if self.rainfall:
            rain_alpha = self.rainfall.alpha(view, size)
            rained = self.rainfall.forward(scene_image, rain_alpha, buffers.array("rained", scene_image.shape))
        misted, mist_root = rained, None
        if self.mist and self.counts(MIST, iteration) and without != MIST:
            mist_root = self.mist.spread(self.mist.knots(view), size)
            misted = self.mist.forward(rained, mist_root, buffers.array("misted", scene_image.shape))
        image, drops = misted, None
        if self.drops and self.counts(DROPS, iteration) and without != DROPS:
            drops = self.drops.layer(view, size)
            image = drops.forward(misted, buffers)
        return Seen(image, misted, rained, rain_alpha, mist_root, drops, view, iteration)

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
            mist_loss_gradient = gradient
            if seen.rain_alpha is not None:
                weights = product(observed.weights, None if seen.drops is None else 1 - seen.drops.alpha)
                mist_loss_gradient = difference_gradient(seen.image, observed.photograph, weights)
            gradient, by_mist = self.mist.backward(
                seen.rained, seen.without_drops, seen.mist_root, seen.view, gradient, mist_loss_gradient, buffers
            )
        if self.rainfall and seen.rain_alpha is not None:
            by_rained = buffers.array("g_rained", gradient.shape)
            gradient = self.rainfall.backward(gradient, seen.rain_alpha, by_rained)
        return gradient, by_mist

    def forward_enhanced(self, scene_image: Image, view: int, iteration: int, buffers: BufferPool) -> Seen:
        """A rendered view [H, W, 3] through the rain that the network leaves in the enhanced photograph.

        That is the mist beyond what the network surely takes away; see `Mist.left_knots`. Arguments as of `forward`.
        """
        misted, mist_root = scene_image, None
        if self.mist and self.counts(MIST, iteration):
            mist_root = self.mist.spread(self.mist.left_knots(view), (scene_image.shape[0], scene_image.shape[1]))
            misted = self.mist.forward(scene_image, mist_root, buffers.array("misted", scene_image.shape))
        return Seen(misted, misted, scene_image, None, mist_root, None, view, iteration)

    def update(self, seen: Seen, observed: Observation, by_mist: MistGradient | None) -> None:
        """Learn of what is on the lens from a view: mist by its gradient, drops from photograph and render."""
        if self.drops and DROPS not in self.off and self.drops.due(seen.iteration):
            self.drops.update(observed.photograph, seen.without_drops, seen.view, observed.shown)
        if self.mist and by_mist is not None:
            self.mist.update(by_mist, seen.iteration)

    def weights(self, view: int, size: Size, iteration: int, drops: DropLayer | None = None) -> Plane | None:
        """Factors [H, W] on pixels' shares of the loss, less where drops hide or cover the scene; None: all 1.

        Args:
            view: index of the view.
            size: its height and width.
            iteration: of the training.
            drops: the layer that the view is seen through at this size; by default it is looked up.
        """
        shown = self.occlusion.shown(view, size, self._views_fitted(view)) if self.occlusion else None
        if self.drops and self.counts(DROPS, iteration):
            return product(shown, 1 - (drops or self.drops.layer(view, size)).alpha)
        return shown

    def rain_alpha(self, view: int, size: Size) -> Plane:
        """rain_alpha [H, W] of a training view at (height, width)."""
        return self.rainfall.alpha(view, size) if self.rainfall else np.zeros(size, np.float32)

    def mist_alpha(self, view: int, size: Size) -> Plane:
        """mist_alpha [H, W] of a training view at (height, width), at the end of the training."""
        counts = self.mist and self.counts(MIST, self.iterations)
        return self.mist.alpha(view, size) if self.mist and counts else np.zeros(size, np.float32)

    def drop_alpha(self, view: int, size: Size) -> Plane:
        """drop_alpha [H, W] of a training view at (height, width), at the end of the training."""
        counts = self.drops and self.counts(DROPS, self.iterations)
        return self.drops.layer(view, size).alpha if self.drops and counts else np.zeros(size, np.float32)

    def occluded(self, view: int, size: Size) -> Plane:
        """The probability [H, W] that drops hide a pixel of a view at (height, width)."""
        if self.occlusion is None:
            return np.zeros(size, np.float32)
        return self.occlusion.prior(view, size, self._views_fitted(view))

    def report(self, views: dict[int, Size]) -> dict[str, float]:
        """Numbers of each layer; of what differs from view to view, the largest of some views.

        Returns:
            `mist_mean` and `mist_max` of mist_alpha, `mist_expected` (mean of the prior), `mist_r`, `mist_g`, `mist_b`
            of its linear light, `fog` (contrast lost over the median depth), `drops` (share of the lens more than half
            covered), `occluded` (mean probability), `recurring` (share of the predicted cover that stays on the lens),
            `rain` (S), `streaks` (mean |D|).
        """
        numbers: dict[str, float] = {}
        if self.mist:
            alphas = [self.mist_alpha(view, size) for view, size in views.items()]
            numbers |= {"mist_mean": max(a.mean() for a in alphas), "mist_max": max(a.max() for a in alphas)}
            numbers["mist_expected"] = self.mist.prior.mean.mean()
            numbers |= {f"mist_{channel}": light for channel, light in zip("rgb", self.mist.colour, strict=True)}
            if paleness := self.mist.prior.evidence.paleness:
                numbers["fog"] = paleness.fog
        if self.drops:
            numbers["drops"] = max((self.drop_alpha(view, size) > COVERED).mean() for view, size in views.items())
        if self.occlusion:
            numbers["occluded"] = max(self.occluded(view, size).mean() for view, size in views.items())
            numbers["recurring"] = self.occlusion.recurring
        if self.rainfall:
            even = numbers["rain"] = self.rainfall.even_alpha
            numbers["streaks"] = max(np.abs(self.rain_alpha(view, size) - even).mean() for view, size in views.items())
        return {name: float(value) for name, value in numbers.items()}

    def needed(self) -> list[str]:
        """The layers that count at the end of the training."""
        on_lens = [layer for layer in (MIST, DROPS) if self.counts(layer, self.iterations)]
        return on_lens + (["rain"] if self.rainfall else [])

    def settings(self) -> dict[str, Any]:
        """The settings; a checkpoint made with others is refused."""
        return {"rain": asdict(self.config), "network": self._network.digest if self._network else None}

    def state_dict(self) -> dict[str, NDArray]:
        """What has been learned of the rain, for checkpoints."""
        arrays: dict[str, NDArray] = {"off": np.array([layer in self.off for layer in (MIST, DROPS)])}
        for part, model in self._parts():
            arrays |= prefixed(part, model.state_dict())
        return arrays

    def load_state_dict(self, arrays: dict[str, NDArray]) -> None:
        """Take back what `state_dict` returned."""
        self.off = {layer for layer, off in zip((MIST, DROPS), arrays["off"], strict=True) if off}
        for part, model in self._parts():
            model.load_state_dict(below(part, arrays))

    def _parts(self) -> list[tuple[str, Any]]:
        parts = (MIST, self.mist), (DROPS, self.drops)
        return [(name, model) for name, model in parts if model is not None]

    def _views_fitted(self, view: int) -> float:
        """To how many views the lines of a view's drops have been fitted, if they count."""
        return self.drops.views_added(view) if self.drops and DROPS not in self.off else 0.0
