"""Mist on the lens: smooth, the same in every view while the scene is not, learned with the scene.

    T = encode((1 - mist_alpha) decode(R) + mist_alpha a)

R is what is seen without mist, and a its light. mist_alpha lies on a coarse grid over the picture, at a few times of
the capture (`time_knots`). Adam learns sqrt(mist_alpha) and a from the gradient of

    loss + prior mean_k log(1 + ((mist_alpha_k - mu_k) / sigma_k)^2) + penalties of roughness, brightness and tint.

What the photographs cannot tell, and what decides it:

* Even mist is as good as a scene of less contrast. The prior (`lens.mist_prior`) says how much there is; its tails are
  those of Cauchy's distribution, as photographs may well show more mist in a place than its sources do.
* Thin bright mist is as good as thicker, darker mist: a is held about as bright as mist should be (`mist_bounds`). Its
  tint can be told, by dark things, and is held loosely.
* A sky that is always in the same corner looks like mist there. But mist only adds light: mist_alpha a is no lighter
  than the darkest that a place of the lens ever shows.

Behind falling rain, mist is learned from differences of pixels alone. SSIM asks for the contrast that streaks give
photographs and renders have not, and less mist is the cheapest way there.
"""

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from baselines.splatting.kernels.adam import adam_step
from baselines.splatting.kernels.buffer_pool import BufferPool
from deraings.image_planes import Plane
from deraings.lens.mist_prior import NetworkMist, mist_prior
from deraings.lens.paleness import MistEvidence
from deraings.lens.time_knots import time_weights
from deraings.rain_model.config import MistConfig
from deraings.rain_model.kernels import add_mist, mist_gradient
from hydroviews.scene.images import Image

ADAM_MOMENTS = ("first", "second")
NOISE = 0.02  # encoded
LEAST_ALPHA = 1e-3  # mist_alpha at the start, at least: from 0 the gradient by its root would be 0
MOST_ALPHA = 0.95
FINAL_RATE = 0.1  # factor to which the rates have fallen at the end, as those of the Gaussians


class MistGradient(NamedTuple):
    """Gradient of the loss, penalties included."""

    roots: NDArray[np.float32]  # [T, h, w], by sqrt(mist_alpha) at the knots
    colour: NDArray[np.float32]  # [3], by the mist's linear light


class Mist:
    """mist_alpha and the mist's light, and how they are learned."""

    def __init__(
        self,
        evidence: MistEvidence,
        iterations: int,
        config: MistConfig,
        network: Callable[[int], NetworkMist | None] = lambda _: None,
    ) -> None:
        """The mist that is to be expected.

        Args:
            evidence: what photographs and scene points show of mist.
            iterations: of the training.
            config: how mist is learned.
            network: the mist that a network predicts on the lens of a view, if it does.
        """
        bounds = evidence.bounds
        self._config, self._n_views, self._iterations = config, bounds.n_views, iterations
        self.expected = bounds.colour  # a, before anything is learned
        self.colour = self.expected.copy()  # a [3], linear light
        self.prior = mist_prior(evidence, network)
        self._most = np.sqrt(np.minimum(config.slack * bounds.max_alpha, MOST_ALPHA))
        self.roots = np.minimum(np.sqrt(self.prior.mean + LEAST_ALPHA), self._most)  # sqrt(mist_alpha) [T, h, w]
        learned = {"roots": self.roots, "colour": self.colour}
        self.steps = np.zeros(1, np.int64)  # of Adam: mist is not learned in every iteration
        self._adam = {f"{name}.{order}": np.zeros_like(v) for name, v in learned.items() for order in ADAM_MOMENTS}

    def alpha(self, view: int, size: tuple[int, int]) -> Plane:
        """mist_alpha [H, W] of a training view at (height, width)."""
        return np.square(self.spread(self.knots(view), size))

    def knots(self, view: int) -> NDArray[np.float32]:
        """sqrt(mist_alpha) at the knots [h, w] at the time of a view."""
        return self._at_time(view, self.roots)

    def left_knots(self, view: int) -> NDArray[np.float32]:
        """The same of the mist that the network leaves in the enhanced photograph of a view.

        1 - mist_alpha = (1 - removed) (1 - left): of two layers of mist, the network takes the second one away.
        """
        removed = np.minimum(self._at_time(view, self.prior.removed), MOST_ALPHA)
        return np.sqrt(np.maximum(np.square(self.knots(view)) - removed, 0) / (1 - removed))

    def spread(self, knots: NDArray[np.float32], size: tuple[int, int]) -> Plane:
        """Values at knots [h, w], at every pixel [H, W] of a view of (height, width)."""
        rows, columns = _spreading(size, self.roots)
        return rows @ knots @ columns.T

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
        by_alpha *= root
        return by_image, self.with_priors(view, 2 * (rows.T @ by_alpha @ columns), by_colour)

    def with_priors(self, view: int, by_knots: NDArray[np.float32], by_colour: NDArray[np.float32]) -> MistGradient:
        """The gradient by all that is learned, with those of the prior and the penalties.

        Args:
            view: whose gradient it is.
            by_knots: of the loss by `knots` [h, w].
            by_colour: of the loss by the mist's light [3].
        """
        config, weights = self._config, time_weights(view, self._n_views, len(self.roots))
        away = np.square(self.roots) - self.prior.mean
        by_roots = weights[:, None, None] * by_knots
        by_roots += (
            np.float32(4 * config.prior / self.roots.size)
            * self.roots
            * away
            / (np.square(self.prior.deviation) + np.square(away))
        )
        by_roots += np.float32(config.roughness / self.roots[0].size) * roughness_gradient(self.roots)
        lighter = self.colour - self.expected
        by_brightness = np.float32(2 * config.brightness) * lighter.mean()
        by_tint = np.float32(2 * config.tint) * (lighter - lighter.mean())
        return MistGradient(by_roots, by_colour + by_brightness + by_tint)

    def update(self, gradient: MistGradient, iteration: int) -> None:
        """One step of Adam, within what the photographs allow."""
        config = self._config
        self.steps += 1
        decay = FINAL_RATE ** (iteration / max(self._iterations, 1))
        self._step("roots", self.roots, gradient.roots, config.rate * decay)
        self._step("colour", self.colour, gradient.colour, config.colour_rate * decay)
        np.clip(self.roots, 0, self._most, out=self.roots)
        np.clip(self.colour, 0, 1, out=self.colour)

    def _at_time(self, view: int, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Values [h, w] at the time of a view, of those at the knots [T, h, w]."""
        at_time: NDArray[np.float32] = np.tensordot(time_weights(view, self._n_views, len(values)), values, 1)
        return at_time

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
    times, height, width = (_curvature(n) for n in knots.shape)
    over_time = (times @ knots.reshape(len(knots), -1)).reshape(knots.shape)
    return np.asarray(over_time + height @ knots + knots @ width, np.float32)


@cache
def _curvature(n: int) -> NDArray[np.float32]:
    """[n, n]: n values on a line become the gradient of half the sum of squared differences of neighbours."""
    steps = np.diff(np.eye(n, dtype=np.float32), axis=0)
    return steps.T @ steps


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
