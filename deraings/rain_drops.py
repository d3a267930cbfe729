"""Drops on the lens: where the rendered scene does not explain what the photographs show, view after view.

At one place of the lens, over the views, let e be the mean squared difference of photograph and render, and s the
variance of the photographs. Where the lens is clear the render predicts the photographs, whatever the scene, and e is
a small part of s. Behind a drop it does not: what a drop shows hardly varies, and e exceeds s. So 1 - e / s, the
coefficient of determination, tells drops from the scene's own fine detail, which is hard to render but moves over the
lens. Bright texture, white walls and fog are explained like everything else that lies in space.

While the render is still poor, or where foliage keeps it so, e is large over wide areas; drops are small, and must
stand out of their surroundings. If water seems to cover nearly everything, only the worst is left out.

Drops grow and run: e and s are taken at a few moments of the film (see `rain_lens`).
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from deraings.planes import within_side
from deraings.rain_lens import moment_weights, moments_of
from hydroviews.images import Image

WINDOW = 3  # pixels of the lens over which e and s are averaged
NOISE = 0.03  # encoded; less than that need not be explained


@dataclass(frozen=True)
class DropConfig:
    """How drops are found."""

    long_side: int = 400  # of the planes in which they are looked for
    views_a_moment: int = 12
    most_moments: int = 3
    fewest_views: int = 6  # fewer say nothing about what is usual at a place of the lens
    start: float = 0.2  # share of the iterations after which pixels are left out
    hidden: float = 0.6  # e / s from which a place counts for less than half
    softness: float = 0.2  # part of that by which e / s falls short of it where a place counts in full
    fewest: float = 0.03  # share of the lens behind drops from which there are any
    most: float = 0.6  # share of the lens, at most, that is left out
    around: float = 0.15  # side, in longer sides of the picture, of the surroundings that a place is compared with
    excess: float = 1.75  # e / s must exceed that of the surroundings by this factor, where the scene is hard to render


class Drops:
    """Running residuals by place on the lens, and the weights of pixels that follow."""

    def __init__(self, pictures: "Spread", n_views: int, iterations: int, config: DropConfig) -> None:
        self._config, self._n_views, self.iterations = config, n_views, iterations
        self._spread = pictures.variance
        self._window = max(4, min(32, n_views // len(self._spread)))  # views that a running mean remembers
        self.residual = np.zeros_like(self._spread)  # sums of squared differences [T, h, w]
        self.count = np.zeros(len(self._spread), np.float32)  # and of weights [T]

    def observe(self, difference: Image, view: int) -> None:
        """Take in photograph minus render [H, W, 3] of a view, mist and rain accounted for."""
        height, width = self._spread.shape[1:]
        squares = np.einsum("hwc,hwc->hw", difference, difference) / np.float32(3)
        if squares.shape != (height, width):
            squares = cv2.resize(squares, (width, height), interpolation=cv2.INTER_AREA)
        for moment, weight in enumerate(moment_weights(view, self._n_views, len(self._spread))):
            if weight > 0:
                keep = np.float32(1 - weight / self._window)
                self.residual[moment] = keep * self.residual[moment] + weight * squares
                self.count[moment] = keep * self.count[moment] + weight

    def unexplained(self, view: int) -> NDArray[np.float32]:
        """e / s [h, w] at a view's moment; nought where nothing is known."""
        weights = moment_weights(view, self._n_views, len(self._spread))
        weights = weights * (self.count > 0)
        if not weights.any():
            return np.zeros(self._spread.shape[1:], np.float32)
        mean = self.residual / np.maximum(self.count, 1e-6)[:, None, None]
        residual = cv2.blur(np.tensordot(weights / weights.sum(), mean, 1), (WINDOW, WINDOW))
        variance = cv2.blur(np.tensordot(weights / weights.sum(), self._spread, 1), (WINDOW, WINDOW))
        return residual / (variance + np.float32(NOISE**2))

    def weights(self, view: int, size: tuple[int, int], iteration: int) -> NDArray[np.float32] | None:
        """Weight of each pixel [H, W] of a view: 0 behind drops; None where every pixel counts in full."""
        config = self._config
        if iteration < config.start * self.iterations or self._n_views < config.fewest_views:
            return None
        ratio = self.unexplained(view)
        side = max(1, round(max(ratio.shape) * config.around)) | 1
        surroundings = cv2.blur(np.minimum(ratio, 1), (side, side))
        ratio = ratio / np.maximum(config.hidden, config.excess * surroundings)
        share = float((ratio > 1).mean())
        if share < config.fewest:
            return None
        if share > config.most:
            ratio /= np.quantile(ratio, 1 - config.most)
        weights = np.clip((1 + config.softness - ratio) / (2 * config.softness), 0, 1).astype(np.float32)
        if weights.shape == size:
            return weights
        return np.asarray(cv2.resize(weights, size[::-1], interpolation=cv2.INTER_LINEAR), np.float32)

    def arrays(self) -> dict[str, NDArray]:
        """All that was observed, for checkpoints."""
        return {"residual": self.residual, "count": self.count}

    def restore(self, arrays: dict[str, NDArray]) -> None:
        """Take back what `arrays` returned."""
        self.residual, self.count = arrays["residual"].copy(), arrays["count"].copy()


class Spread:
    """How much photographs [N, H, W, 3] vary at each place of the lens, at each moment of the film."""

    def __init__(self, pictures: list[NDArray[np.uint8]], config: DropConfig) -> None:
        n = len(pictures)
        height, width = within_side(pictures[0].shape[:2], config.long_side)
        size = width, height
        moments = moments_of(n, config.views_a_moment, config.most_moments)
        sums = np.zeros((3, moments, size[1], size[0], 3), np.float32)
        for index, pixels in enumerate(pictures):
            small = cv2.resize(pixels, size, interpolation=cv2.INTER_AREA) if pixels.shape[1::-1] != size else pixels
            values = small.astype(np.float32) / np.float32(255)
            for moment, weight in enumerate(moment_weights(index, n, moments)):
                if weight > 0:
                    sums[0, moment] += weight
                    sums[1, moment] += weight * values
                    sums[2, moment] += weight * values * values
        mean = sums[1] / sums[0]
        self.variance = np.maximum(sums[2] / sums[0] - mean * mean, 0).mean(axis=3)
