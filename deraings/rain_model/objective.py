"""The objective of `deraings` and `deraings-plus`: see the package's docstring.

loss = sum (1 - r) (1 - M) rho(photograph - model.forward(scene_image).image)   in most steps
     = sum (1 - r) (1 - M) rho(enhanced photograph - scene_image)               in others, at first in more of them
"""

from collections.abc import Callable
from functools import cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from baselines.masking.pixel_weights import PixelWeights
from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.kernels.photometric import Target, photometric_loss, prepare_target
from baselines.splatting.objective import Objective, OnGPU
from baselines.training.checkpoints import below, prefixed
from baselines.training.images import Size, TrainingImages
from baselines.training.torch_state import fetched, sent
from deraings.enhancement.views import EnhancedViews
from deraings.image_planes import Plane, product
from deraings.lens.paleness import MistEvidence
from deraings.rain_model.config import RainConfig
from deraings.rain_model.drops import DropLayer
from deraings.rain_model.model import DROPS, MIST, Observation, RainModel
from deraings.rain_model.on_gpu import RainOnGPU
from hydroviews.scene.images import Image

GOLDEN = (5**0.5 - 1) / 2  # multiples of it, modulo 1, are spread evenly over [0, 1)
KEPT_OF = 12  # one of so many views is kept from the scene at first
LEAST_VIEWS = 24  # fewer lack each one that is kept
LEAST_GAIN = {MIST: -2.0, DROPS: 2.0}  # standard errors by which a layer has to predict better, to count further
LEAST_ERROR = 1e-6  # of a mean gain


class RainObjective(Objective):
    """The photometric loss of the scene as it is seen through the rain."""

    def __init__(
        self,
        images: TrainingImages,
        iterations: int,
        config: RainConfig | None = None,
        lambda_dssim: float = 0.2,
        pixel_weights: PixelWeights | None = None,
        network: EnhancedViews | None = None,
        evidence: Callable[[], MistEvidence] | None = None,
        covers: EnhancedViews | None = None,
    ) -> None:
        """An objective that has learned nothing of the rain yet; what is not explained: see `RainModel`.

        Args:
            config: which kinds of rain are modelled; all of them by default.
            lambda_dssim: lambda of the photometric loss.
            pixel_weights: such as occlusion masks; they weigh the loss that the rain model leaves.
        """
        super().__init__(images, lambda_dssim, pixel_weights=pixel_weights)
        config = config or RainConfig()
        self.model = RainModel(images, iterations, config, network, evidence, covers)
        self.enhanced = EnhancedTargets(network, len(images), iterations, config.enhanced) if network else None
        first, last = (round(share * iterations) for share in (config.start, config.trial))
        self.trial = Trial(self.model, len(images), first, last)
        self._on_gpu = RainOnGPU(self.model)

    def weights(
        self,
        render: Callable[[], Image],
        view: int,
        size: Size,
        iteration: int,
        buffers: BufferPool,
        drops: DropLayer | None = None,
    ) -> Plane | None:
        """See Objective: (1 - r) (1 - M), times the pixel weights.

        `drops` is the layer that the view is seen through, if it is known at its size.
        """
        weights = super().weights(render, view, size, iteration, buffers)
        return product(self.model.weights(view, size, iteration, drops), weights)

    def __call__(self, image: Image, view: int, iteration: int, buffers: BufferPool) -> tuple[float, Image]:
        """See Objective; learns of the rain as well. Pixels that are not finite count for nothing."""
        size = image.shape[0], image.shape[1]
        target = self.target(view, size)
        image, finite = _finite(image)
        if self.trial.keeps(view, iteration):
            return self.trial.look(image, target, view, iteration, buffers), np.zeros_like(image)
        seen = self.model.forward(image, view, iteration, buffers)
        shown = product(target.shown, finite)
        weights = product(self.weights(lambda: seen.image, view, size, iteration, buffers, seen.drops), shown)
        observed = Observation(target.image, shown, weights)
        if self.enhanced and self.enhanced.due(view, iteration):
            self.model.update(seen, observed, None)
            left = self.model.forward_enhanced(image, view, iteration, buffers)
            enhanced = self.enhanced.target(view, size)
            loss, gradient = photometric_loss(left.image, enhanced, self.lambda_dssim, weights, buffers)
            return loss, self.model.backward(left, gradient, observed, buffers)[0]
        loss, gradient = photometric_loss(seen.image, target, self.lambda_dssim, weights, buffers)
        by_scene, by_mist = self.model.backward(seen, gradient, observed, buffers)
        self.model.update(seen, observed, by_mist)
        return loss, by_scene

    def on_gpu(self, render: Tensor, view: int, iteration: int, buffers: BufferPool) -> OnGPU:
        """See Objective; learns as `__call__` does."""
        size = render.shape[0], render.shape[1]
        target = self.target(view, size)
        if self.trial.keeps(view, iteration):
            self.trial.look(fetched(render), target, view, iteration, buffers)
            return OnGPU(render, sent(np.zeros(size, np.float32)))
        seen = self._on_gpu.forward(render, view, iteration)
        left = self.weights(cache(lambda: fetched(seen.image)), view, size, iteration, buffers)
        weights = None if left is None else sent(left)
        if self.enhanced and self.enhanced.due(view, iteration):
            learn = partial(self._on_gpu.update, seen._replace(mist=None), target, weights)
            image = self._on_gpu.forward_enhanced(render, view, iteration)
            return OnGPU(image, weights, self.enhanced.target(view, size), learn=learn)
        return OnGPU(seen.image, weights, learn=partial(self._on_gpu.update, seen, target, weights))

    def residual(self, image: Image, view: int, buffers: BufferPool) -> float:
        """See Objective."""
        seen = self.model.forward(image, view, self.model.iterations, buffers)
        return photometric_loss(seen.image, self.target(view), self.lambda_dssim, buffers=buffers)[0]

    def hidden(self, view: int, size: Size) -> Plane:
        """How much of each pixel [H, W] of a view of (height, width) is taken for rain after training."""
        model = self.model
        covers = [cover(view, size) for cover in (model.mist_alpha, model.drop_alpha, model.occluded, model.rain_alpha)]
        left = np.prod([1 - cover for cover in covers], axis=0)
        return np.clip(1 - left, 0, 1).astype(np.float32)

    def report(self) -> dict[str, Any]:
        """What was found of the rain, in the first, the middle and the last view.

        Returns:
            `needed`: the layers that count, then numbers of all; see `RainModel.report` and `Trial.report`. `enhanced`
            is the share of the first steps that compare with enhanced photographs. Then what pixel weights report.
        """
        last = len(self.images) - 1
        shapes = {view: self.images.pixels(view).shape for view in (0, last // 2, last)}
        numbers = self.model.report({view: (shape[0], shape[1]) for view, shape in shapes.items()})
        numbers |= self.trial.report()
        if self.enhanced:
            numbers["enhanced"] = self.enhanced.share
        found = {name: round(value, 4) for name, value in numbers.items()}
        return {"needed": self.model.needed(), **found, **super().report()}

    def settings(self) -> dict[str, Any]:
        """See Objective."""
        return {**super().settings(), **self.model.settings()}

    def state_dict(self) -> dict[str, NDArray]:
        """See Objective."""
        return super().state_dict() | self.model.state_dict() | prefixed("trial", self.trial.state_dict())

    def load_state_dict(self, arrays: dict[str, NDArray]) -> None:
        """See Objective."""
        super().load_state_dict(arrays)
        self.model.load_state_dict(arrays)
        self.trial.load_state_dict(below("trial", arrays))


class EnhancedTargets:
    """The enhanced photographs, as a second target of the scene as it is.

    Mist that is taken for a little too thick leaves a scene that is a little too dark, and the photographs fit all the
    same; streaks are learned until they are known. An enhanced photograph has other errors. A step compares with the
    enhanced photograph with the probability lambda(t) c: lambda falls from 1 to 0, and c is the share of what the
    network changes in this photograph that is not its own error, as the network expects it. Within a photograph the
    expected error weighs nothing: it made no difference.
    """

    def __init__(self, network: EnhancedViews, n_views: int, iterations: int, until: float) -> None:
        """Judge every photograph's enhancement.

        Args:
            network: the photographs as a network enhances them.
            n_views: how many there are.
            iterations: of the training.
            until: share of the iterations at which lambda is 0.

        Raises:
            InputError: a kept picture is damaged.
        """
        self._last = until * iterations
        self._images = network.training_images() if until else None
        self._shares = [network.change_over_error(view) for view in range(n_views)] if until else [0.0]
        self.share = float(np.mean(self._shares))

    def due(self, view: int, iteration: int) -> bool:
        """Whether the scene is compared with the view's enhanced photograph in this step."""
        if iteration >= self._last:
            return False
        return iteration * GOLDEN % 1 < (1 - iteration / self._last) * self._shares[view]

    def target(self, view: int, size: Size) -> Target:
        """An enhanced photograph at (height, width)."""
        assert self._images is not None  # no step is due otherwise
        return prepare_target(self._images.pixels(view, size), self._images.ignored(view, size))


class Trial:
    """Whether layers on the lens predict photographs better than their absence does.

    One view in KEPT_OF is kept from the scene at first. The scene that the others learn, seen through what is on the
    lens, predicts the kept photograph. A layer's gain g is the mean absolute error without it less that with it, after
    gain and offset of each channel have been fitted to the photograph in both cases: a scene that has been learned
    through even mist is darker, and would seem to need it. At the end of the trial drops count no more unless the
    mean g is more than two standard errors above 0 (7.8 and more in drops of development scenes, 1.3 at most on dry
    lenses). Even mist has no gain, as it cannot be told from a pale scene: it counts no more if the mean g is more than
    two standard errors below 0, and priors decide on the rest. Where there are too few views to keep one, all counts
    that did.
    """

    def __init__(self, model: RainModel, n_views: int, first: int, last: int) -> None:
        """A trial from the iteration `first` to `last`, both of the training."""
        self._model, self._first, self._last = model, first, last
        self._kept = set(range(KEPT_OF // 2, n_views, KEPT_OF)) if n_views >= LEAST_VIEWS else set()
        self.gains: dict[str, list[float]] = {MIST: [], DROPS: []}

    def keeps(self, view: int, iteration: int) -> bool:
        """Whether a view is kept from the scene in this step; decides once, when the trial is over."""
        if iteration >= self._last and self._kept:
            tried = {layer: gains for layer, gains in self.gains.items() if len(gains) > 1}
            self._model.off |= {layer for layer, gains in tried.items() if _in_errors(gains) < LEAST_GAIN[layer]}
            self._kept = set()
        return view in self._kept

    def look(self, image: Image, target: Target, view: int, iteration: int, buffers: BufferPool) -> float:
        """Predict the photograph of a kept view from its render [H, W, 3]; the mean absolute error."""
        error = prediction_error(self._model.forward(image, view, iteration, buffers).image, target)
        if 2 * iteration > self._first + self._last:  # before, the scene is not learned enough
            for layer in (MIST, DROPS):
                if self._model.counts(layer, iteration):
                    seen = self._model.forward(image, view, iteration, buffers, without=layer)
                    self.gains[layer].append(prediction_error(seen.image, target) - error)
        return error

    def report(self) -> dict[str, float]:
        """The gain of each layer in standard errors, such as `drops_gain`."""
        return {f"{layer}_gain": _in_errors(gains) for layer, gains in self.gains.items() if len(gains) > 1}

    def state_dict(self) -> dict[str, NDArray]:
        """All gains so far, and whether the trial goes on."""
        return {**{layer: np.array(gains) for layer, gains in self.gains.items()}, "kept": np.array(sorted(self._kept))}

    def load_state_dict(self, arrays: dict[str, NDArray]) -> None:
        """Take back what `state_dict` returned."""
        self.gains = {layer: arrays[layer].tolist() for layer in self.gains}
        self._kept = {int(view) for view in arrays["kept"]}


def prediction_error(seen: Image, target: Target) -> float:
    """The mean absolute error [0, 1] of a view [H, W, 3] of a photograph, gain and offset of each channel fitted."""
    shown = slice(None) if target.ignored is None else ~target.ignored
    found, true = seen[shown].reshape(-1, 3), target.image[shown].reshape(-1, 3)
    mean, true_mean = found.mean(axis=0), true.mean(axis=0)
    gain = ((found - mean) * (true - true_mean)).mean(axis=0) / np.maximum(found.var(axis=0), 1e-6)
    return float(np.abs(true - true_mean - gain * (found - mean)).mean())


def _in_errors(gains: list[float]) -> float:
    """The mean of two gains or more, in standard errors of the mean."""
    return float(np.mean(gains) / max(np.std(gains, ddof=1) / np.sqrt(len(gains)), LEAST_ERROR))


def _finite(image: Image) -> tuple[Image, Plane | None]:
    """A render [H, W, 3] with 0 where a pixel is not finite, and 1 where it is [H, W]; None where all are."""
    finite = np.isfinite(image)
    if finite.all():
        return image, None
    finite = finite.all(axis=2)
    return np.where(finite[..., None], image, np.float32(0)), finite.astype(np.float32)
