"""Drops on the lens: what they take from the scene, and what they add, told from how photographs follow the render.

A drop that covers a share M of a pixel leaves 1 - M of the scene, and adds light of its own, which hardly varies: it
shows much of the scene at once, out of focus. Over the views, a pixel of the lens is therefore a line,

    photograph = (1 - M) render + L,

whose slope is the covariance of photograph and render over the render's variance. Where the lens is clear the slope is
one, whatever the scene: what is hard to render makes the render smoother, not the photograph less like it. Bright
texture, white walls and fog move over the lens and are followed like everything else that lies in space. The render is
then compared as it is seen through the drops, so that pixels which are partly covered go on telling of the scene; where
next to nothing is left of it, pixels count for nothing.

What the photographs cannot tell: L without M would be a stain of light that any scene could lose to the lens; L is at
most M times white, and M is nought where the slope is near one. Drops grow and run: lines are fitted at a few moments
of the film (see `rain_lens`).
"""

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from deraings.planes import Plane, resized, within_side
from deraings.rain_lens import moment_weights, moments_of
from hydroviews.images import Image

LEAST_WINDOW, LARGEST_WINDOW = 4, 32  # views that running means remember
PLANES = 8  # photograph and render, three channels each; means over channels of their product and of its square


@dataclass(frozen=True)
class DropConfig:
    """How drops are found."""

    long_side: int = 400  # of the planes in which they are looked for
    views_a_moment: int = 12
    most_moments: int = 3
    fewest_views: int = 6  # fewer say nothing about what is usual at a place of the lens
    start: float = 0.2  # share of the iterations after which the render is seen through drops
    noise: float = 0.05  # encoded; where the render varies less, slopes are drawn to one
    clear: float = 0.1  # M up to which the lens counts as clear
    wet: float = 0.25  # M from which it counts for what it is
    fewest: float = 0.03  # share of the lens more than half covered from which there are any drops
    most: float = 0.6  # share of the lens that may be more than half covered
    hidden: float = 0.75  # M from which a pixel does not count
    shown: float = 0.3  # M up to which it counts in full


class Water(NamedTuple):
    """What drops do to a view."""

    cover: Plane  # M [H, W] in [0, 1]
    light: Image  # L [H, W, 3], sRGB-encoded
    weights: Plane  # factors [H, W] on each pixel's share of the loss

    def over(self, image: Image) -> Image:
        """A view [H, W, 3] as it is seen through the drops."""
        return (1 - self.cover)[..., None] * image + self.light


class Drops:
    """Running sums by place on the lens, and the water that follows."""

    def __init__(self, size: tuple[int, int], n_views: int, iterations: int, config: DropConfig) -> None:
        """A lens of which nothing is known.

        Args:
            size: height and width of the first view.
            n_views: in order of the film.
            iterations: of the training.
            config: settings.
        """
        self._config, self._n_views, self.iterations = config, n_views, iterations
        moments = moments_of(n_views, config.views_a_moment, config.most_moments)
        self._window = max(LEAST_WINDOW, min(LARGEST_WINDOW, n_views // moments))
        self.sums = np.zeros((moments, PLANES, *within_side(size, config.long_side)), np.float32)
        self.count = np.zeros(moments, np.float32)  # sums of the views' weights

    def observe(self, photograph: Image, seen: Image, view: int) -> None:
        """Take in a photograph [H, W, 3] and its render, mist and falling rain accounted for, drops not."""
        size = self.sums.shape[2:]
        planes = np.empty((PLANES, *size), np.float32)
        for at, image in ((0, photograph), (3, seen)):
            small = image if image.shape[:2] == size else cv2.resize(image, size[::-1], interpolation=cv2.INTER_AREA)
            planes[at : at + 3] = np.moveaxis(small, 2, 0)
        np.einsum("chw,chw->hw", planes[:3], planes[3:6] / 3, out=planes[6])
        np.einsum("chw,chw->hw", planes[3:6], planes[3:6] / 3, out=planes[7])
        for moment, weight in enumerate(moment_weights(view, self._n_views, len(self.sums))):
            if weight > 0:
                keep = np.float32(1 - weight / self._window)
                self.sums[moment] *= keep
                self.sums[moment] += weight * planes
                self.count[moment] = keep * self.count[moment] + weight

    def line(self, view: int) -> tuple[Plane, Image] | None:
        """1 - slope [h, w] and M times light [h, w, 3] at a view's moment; None where nothing is known."""
        weights = moment_weights(view, self._n_views, len(self.sums)) * (self.count > 0)
        if not weights.any():
            return None
        config = self._config
        mean = np.tensordot(weights, self.sums, 1) / np.float32(weights @ self.count)
        photograph, seen = mean[:3], mean[3:6]
        together = mean[6] - (photograph * seen).mean(axis=0)
        alone = np.maximum(mean[7] - (seen * seen).mean(axis=0), 0)
        lost = 1 - (together + config.noise**2) / (alone + config.noise**2)
        cover = np.clip(lost, 0, 1) * _step(lost, config.clear, config.wet)
        light = np.clip(photograph - (1 - cover) * seen, 0, cover)
        return cover.astype(np.float32), np.ascontiguousarray(np.moveaxis(light, 0, 2), np.float32)

    def water(self, view: int, size: tuple[int, int], iteration: int) -> Water | None:
        """What is on the lens in a view, at any size (height, width); None where there are no drops."""
        config = self._config
        if iteration < config.start * self.iterations or self._n_views < config.fewest_views:
            return None
        found = self.line(view)
        if found is None or (found[0] > 0.5).mean() < config.fewest:
            return None
        cover, light = found
        excess = float(np.quantile(cover, 1 - config.most)) - 0.5
        if excess > 0:  # a scene that is not learned yet, or water all over: part of the lens must go on teaching
            cover = np.maximum(cover - excess, 0)
            light = np.minimum(light, cover[..., None])
        if cover.shape != size:
            cover = resized(cover, size)
            light = np.asarray(cv2.resize(light, size[::-1], interpolation=cv2.INTER_LINEAR), np.float32)
        return Water(cover, light, 1 - _step(cover, config.shown, config.hidden).astype(np.float32))

    def arrays(self) -> dict[str, NDArray]:
        """All that was observed, for checkpoints."""
        return {"sums": self.sums, "count": self.count}

    def restore(self, arrays: dict[str, NDArray]) -> None:
        """Take back what `arrays` returned."""
        self.sums, self.count = arrays["sums"].copy(), arrays["count"].copy()


def _step(values: Plane, low: float, high: float) -> Plane:
    """A smooth rise from 0 at `low` to 1 at `high`."""
    rise = np.clip((values - low) / (high - low), 0, 1)
    return rise * rise * (3 - 2 * rise)
