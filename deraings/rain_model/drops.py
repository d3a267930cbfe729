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
of the film (see `moments`).
"""

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from deraings.planes import Plane, resized, within_side
from deraings.rain_model.drops_kernels import SUMS, add_view, fit_lines, warm_up
from deraings.rain_model.moments import moment_weights, moments_of
from hydroviews.scene.images import Image

HALF = np.float32(0.5)
WHOLE = 0.999  # of a pixel that no hidden one touches, after resizing
LEAST_WINDOW, LARGEST_WINDOW = 4, 32  # views that running means remember


@dataclass(frozen=True)
class DropConfig:
    """How drops are found."""

    long_side: int = 400  # of the planes in which they are looked for
    views_a_moment: int = 12
    most_moments: int = 3
    fewest_views: int = 6  # fewer say nothing about what is usual at a place of the lens
    start: float = 0.05  # share of the iterations before the render is seen through drops; views are not yet learned
    noise: float = 0.04  # encoded; where the render varies less, slopes are drawn to one
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
        self._config, self._n_views = config, n_views
        self._first = config.start * iterations
        moments = moments_of(n_views, config.views_a_moment, config.most_moments)
        self._window = max(LEAST_WINDOW, min(LARGEST_WINDOW, n_views // moments))
        self.sums = np.zeros((moments, *within_side(size, config.long_side), SUMS), np.float32)
        warm_up()

    def observe(self, photograph: Image, seen: Image, view: int, shown: Plane | None = None) -> None:
        """Take in a photograph [H, W, 3] and its render, mist and falling rain accounted for, drops not.

        Where `shown` [H, W] is not 1 the view says nothing; by default it is 1 everywhere.
        """
        size = self.sums.shape[1:3]
        whole = np.ones(size, np.bool_) if shown is None else resized(shown, size) > WHOLE
        small = [
            np.ascontiguousarray(
                image if image.shape[:2] == size else cv2.resize(image, size[::-1], interpolation=cv2.INTER_AREA),
                np.float32,
            )
            for image in (photograph, seen)
        ]
        for moment, weight in enumerate(moment_weights(view, self._n_views, len(self.sums))):
            if weight > 0:
                keep = np.float32(1 - weight / self._window)
                add_view(*small, whole, keep, weight, self.sums[moment])

    def line(self, view: int) -> tuple[Plane, Image]:
        """1 - slope [h, w] and M times light [h, w, 3] at a view's moment; nought where nothing is known."""
        config, size = self._config, self.sums.shape[1:3]
        shares = moment_weights(view, self._n_views, len(self.sums))
        cover, light = np.empty(size, np.float32), np.empty((*size, 3), np.float32)
        noise, clear, wet = (np.float32(value) for value in (config.noise, config.clear, config.wet))
        fit_lines(self.sums, shares, noise, clear, wet, cover, light)
        return cover, light

    def water(self, view: int, size: tuple[int, int], iteration: int) -> Water | None:
        """What is on the lens in a view, at any size (height, width); None where there are no drops."""
        config = self._config
        if iteration < self._first or self._n_views < config.fewest_views:
            return None
        cover, light = self.line(view)
        share = float((cover > HALF).mean())
        if share < config.fewest:
            return None
        if share > config.most:
            # a scene that is not learned yet, or water all over: part of the lens must go on teaching
            cover = np.maximum(cover - (np.quantile(cover, 1 - config.most) - HALF), 0).astype(np.float32)
            light = np.minimum(light, cover[..., None])
        if cover.shape != size:
            cover = resized(cover, size)
            light = np.asarray(cv2.resize(light, size[::-1], interpolation=cv2.INTER_LINEAR), np.float32)
        return Water(cover, light, _counted(cover, config.shown, config.hidden))

    def state_dict(self) -> dict[str, NDArray]:
        """All that was observed, for checkpoints."""
        return {"sums": self.sums}

    def load_state_dict(self, arrays: dict[str, NDArray]) -> None:
        """Take back what `arrays` returned."""
        self.sums = arrays["sums"].copy()


def _counted(cover: Plane, shown: float, hidden: float) -> Plane:
    """Factors on the loss: 1 up to a cover of `shown`, 0 from `hidden` on."""
    fall = np.clip((np.float32(hidden) - cover) / np.float32(hidden - shown), 0, 1)
    return fall * fall * (3 - 2 * fall)
