"""Mist on the lens: smooth, the same in every view while the scene is not, learned with the scene.

    T = encode((1 - mist_alpha) decode(R) + mist_alpha a)

R is what is seen without mist, and a its light. mist_alpha lies on a coarse grid over the picture, at a few times of
the capture (see `time_knots`); both are learned by Adam from the gradient of the photometric loss.

Behind falling rain, mist that a network surely sees is learned from differences alone. SSIM asks for the contrast that
streaks give photographs and renders have not, and less mist is the cheapest way there: of courtyard's mist before
streaks a ninth was left. Where there is no mist, SSIM keeps rain from being taken for it.

What the photographs cannot tell, and what decides it:

* Even mist is as good as a scene of less contrast: a penalty on the mean of mist_alpha keeps its thinnest place clear.
* Thin bright mist is as good as thicker, darker mist: a is held about as bright as mist should be (`mist_bounds`). Its
  tint can be told, by dark things, and is held loosely.
* A sky that is always in the same corner looks like mist there. But mist only adds light, so that mist_alpha a is no
  lighter than the darkest that a place of the lens ever shows. Learning starts below that bound and stays near it.
  Where every place shows something dark, there is next to none, and only a network's word on it is believed.
* Fog in the scene makes points paler with their distance, not with their place on the lens (`mist_or_fog`). Where it is
  foggy no mist is looked for.
* Little mist makes points hardly paler. A network that has seen many lenses tells it from none.
"""

from collections.abc import Callable, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from baselines.splatting.kernels.adam import adam_step
from baselines.splatting.kernels.buffer_pool import BufferPool
from deraings.enhancement.views import EnhancedViews
from deraings.image_planes import Plane
from deraings.rain_model.mist_bounds import mist_bounds
from deraings.rain_model.mist_config import MistConfig
from deraings.rain_model.mist_kernels import add_mist, mist_gradient
from deraings.rain_model.mist_or_fog import is_mist, paleness_of, sees_mist
from deraings.rain_model.time_knots import time_weights
from hydroviews.scene.images import Image
from hydroviews.scene.point_colours import PointColours

ADAM_MOMENTS = ("first", "second")
NOISE = 0.02  # encoded
MIN_ALPHA = 1e-3  # mist_alpha at the start, at least: from 0 the gradient by its root would be 0


class MistGradient(NamedTuple):
    """Gradient of the loss, penalties included."""

    roots: NDArray[np.float32]  # [T, h, w], by sqrt(mist_alpha) at the knots
    colour: NDArray[np.float32]  # [3], by the mist's linear light


class Mist:
    """mist_alpha and the mist's light, and how they are learned."""

    def __init__(
        self,
        pictures: Sequence[NDArray[np.uint8]],
        iterations: int,
        config: MistConfig,
        hidden: Sequence[NDArray[np.bool_] | None] = (),
        points: Callable[[], PointColours] | None = None,
        prior: EnhancedViews | None = None,
    ) -> None:
        """Look for mist in the photographs.

        Args:
            pictures: [H, W, 3] each, in order of name.
            iterations: of the training.
            config: how mist is learned.
            hidden: masks [H, W] of pixels that are not looked at.
            points: looks up scene points in the pictures, called only where there may be mist. Without it, or with too
                few points, what may be mist is taken for mist, unless the prior says otherwise.
            prior: the photographs without rain as far as a network sees it.
        """
        self._config, self._n_views, self._iterations = config, len(pictures), iterations
        self._first = round(config.start * iterations)
        bounds = mist_bounds(pictures, config, hidden)
        self.expected = bounds.colour  # a, before anything is learned
        self.colour = self.expected.copy()  # a [3], linear light
        light = prior.mist_light() if prior is not None else None
        self.seen = None if light is None else light / float(self.expected[0])  # mist_alpha, as the prior has it
        suspected = bounds.partly or sees_mist(self.seen, config)
        self.paleness = paleness_of(bounds, points) if suspected and points is not None else None
        told = self.paleness is not None or self.seen is not None
        self.wanted = suspected and is_mist(self.paleness, self.seen, config) if told else bounds.mostly
        self._max_roots = np.sqrt(np.minimum(config.slack * bounds.max_alpha, config.max_alpha))
        likely = config.likely * bounds.possible + MIN_ALPHA
        roots = np.minimum(np.sqrt(likely), self._max_roots) * self.wanted
        self.roots = roots.astype(np.float32)  # sqrt(mist_alpha) [T, h, w] at the knots
        learned = {"roots": self.roots, "colour": self.colour}
        self.steps = np.zeros(1, np.int64)  # of Adam: mist is not learned in every iteration
        self._adam = {f"{name}.{order}": np.zeros_like(v) for name, v in learned.items() for order in ADAM_MOMENTS}

    @property
    def sure_in_rain(self) -> bool:
        """Whether the prior sees so much mist that there is some even if it rains."""
        return self.seen is not None and self.seen >= self._config.min_seen_in_rain

    def due(self, iteration: int) -> bool:
        """Whether views are seen through mist in this step."""
        return iteration >= self._first and self.wanted

    def alpha(self, view: int, size: tuple[int, int]) -> Plane:
        """mist_alpha [H, W] of a training view at (height, width)."""
        return np.square(self.root(view, size))

    def root(self, view: int, size: tuple[int, int]) -> Plane:
        """sqrt(mist_alpha) [H, W] of a view."""
        rows, columns = _spreading(size, self.roots)
        return rows @ self.knots(view) @ columns.T

    def knots(self, view: int) -> NDArray[np.float32]:
        """The same at its knots [h, w]."""
        knots: NDArray[np.float32] = np.tensordot(time_weights(view, self._n_views, len(self.roots)), self.roots, 1)
        return knots

    def forward(self, image: Image, root: Plane, out: Image) -> Image:
        """A view [H, W, 3] as it is seen through the mist of its `root`, written to `out`."""
        return add_mist(image, np.square(root), self.colour, out)

    def backward(
        self, image: Image, misted: Image, root: Plane, view: int, gradient: Image, told: Image, buffers: BufferPool
    ) -> tuple[Image, MistGradient]:
        """Gradients by the image [H, W, 3], in one of the buffers, and by what is learned.

        Args:
            image: as given to `forward`, [H, W, 3].
            misted: what that returned.
            root: as given to it.
            view: whose root it is.
            gradient: of the loss by what `forward` returned.
            told: the same, or that of differences alone: of the loss that mist is learned from.
            buffers: to reuse.
        """
        alpha = np.square(root)
        by_image, by_alpha, by_colour = mist_gradient(image, misted, alpha, self.colour, gradient, told, buffers)
        rows, columns = _spreading(root.shape, self.roots)
        by_knots = rows.T @ (2 * root * (by_alpha + np.float32(self.mean_penalty / root.size))) @ columns
        return by_image, self.learned_from(view, by_knots, by_colour)

    @property
    def mean_penalty(self) -> float:
        """What the mean of mist_alpha adds to the loss."""
        return self._config.mean_penalty

    def learned_from(self, view: int, by_knots: NDArray[np.float32], by_colour: NDArray[np.float32]) -> MistGradient:
        """The gradient by all that is learned, with the other penalties.

        Args:
            view: whose gradient it is.
            by_knots: of the loss and the penalty on the mean, by `knots`, [h, w].
            by_colour: of the loss by the mist's light [3].
        """
        config, weights = self._config, time_weights(view, self._n_views, len(self.roots))
        by_roots = weights[:, None, None] * by_knots
        by_roots += np.float32(config.roughness_penalty / self.roots[0].size) * roughness_gradient(self.roots)
        lighter = self.colour - self.expected
        by_brightness = np.float32(2 * config.brightness_penalty) * lighter.mean()
        by_tint = np.float32(2 * config.tint_penalty) * (lighter - lighter.mean())
        return MistGradient(by_roots, by_colour + by_brightness + by_tint)

    def update(self, gradient: MistGradient, iteration: int) -> None:
        """One step of Adam, within what the photographs allow."""
        config = self._config
        self.steps += 1
        decay = config.final_rate ** (iteration / max(self._iterations, 1))
        self._step("roots", self.roots, gradient.roots, config.rate * decay)
        self._step("colour", self.colour, gradient.colour, config.colour_rate * decay)
        np.clip(self.roots, 0, self._max_roots, out=self.roots)
        np.clip(self.colour, 0, 1, out=self.colour)

    def state_dict(self) -> dict[str, NDArray]:
        """All that is learned, for checkpoints."""
        return {"roots": self.roots, "colour": self.colour, "steps": self.steps, **self._adam}

    def load_state_dict(self, arrays: dict[str, NDArray]) -> None:
        """Take back what `state_dict` returned."""
        self.roots, self.colour = arrays["roots"].copy(), arrays["colour"].copy()
        self.steps = arrays["steps"].copy()
        self._adam = {name: arrays[name].copy() for name in self._adam}

    def _step(self, name: str, values: NDArray, gradient: NDArray, rate: float) -> None:
        first, second = (self._adam[f"{name}.{order}"] for order in ADAM_MOMENTS)
        gradient = np.ascontiguousarray(gradient, np.float32)
        adam_step(values, gradient, first, second, int(self.steps[0]), rate)


def difference_gradient(seen: Image, photograph: Image, weights: Plane | None) -> Image:
    """The gradient of the mean difference by what is seen [H, W, 3], pixels weighed by `weights` [H, W].

    That of absolute differences; less where they are below NOISE, whose sign says little.
    """
    gradient = np.clip((seen - photograph) / np.float32(NOISE), -1, 1)
    gradient *= np.float32(1 / gradient.size) if weights is None else weights[..., None] / np.float32(gradient.size)
    return gradient


def roughness_gradient(knots: NDArray[np.float32]) -> NDArray[np.float32]:
    """Of half the sum of squared differences of neighbouring knots [T, h, w], in space and in time."""
    gradient = np.zeros_like(knots)
    for axis in range(3):
        along, values = np.moveaxis(gradient, axis, 0), np.moveaxis(knots, axis, 0)
        steps = np.diff(values, axis=0)
        along[1:] += steps
        along[:-1] -= steps
    return gradient


def _spreading(size: tuple[int, ...], roots: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """R and C, for roots [T, h, w] at (height, width); see `spreading`."""
    return spreading(size[0], roots.shape[1]), spreading(size[1], roots.shape[2])


@cache
def spreading(pixels: int, knots: int) -> NDArray[np.float32]:
    """What values of knots on a line, the outermost on its ends, weigh in its pixels, linear between them.

    [pixels, knots], shared, not to be written to. A grid [h, w] has the values R grid C^T at all pixels, with such
    matrices R [H, h] and C [W, w]; R^T plane C takes gradients back.
    """
    place = (np.arange(pixels) + 0.5) / pixels * (knots - 1)
    weights = np.maximum(0, 1 - np.abs(place[:, None] - np.arange(knots))).astype(np.float32)
    weights.flags.writeable = False
    return weights
