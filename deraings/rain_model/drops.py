"""Drops on the lens: what they block of the scene and what they add, from how photographs follow the render.

A drop that covers the share drop_alpha of a pixel leaves 1 - drop_alpha of what lies behind, and shows much of the
scene at once instead, out of focus: light that follows that of its surroundings C, the mean render around it, but for
what is the drop's own. Over the views, a pixel of the lens is therefore a line,

    photograph - C = (1 - drop_alpha) (render - C) + L,

whose slope is the covariance of both differences over the variance of the render's. (With L alone, drops that cover all
had slopes of 0.1 to 0.6: where a view is light, so are the drops in it.) Where the lens is clear the slope is one,
whatever the scene: what is hard to render makes the render smoother, not the photograph less like it. Bright texture,
white walls and fog move over the lens and are followed like everything else that lies in space. The render is then
compared as it is seen through the drops, so that partly covered pixels still teach the scene; pixels of which next to
nothing is left count for nothing.

A line is believed only where detail stays on the lens (`fixed_pattern`). Where the scene is not learned, or learned
wrong, photographs do not follow the render either: trees in wind have slopes like drops, and what is taken for a drop
is never learned afterwards. But no detail of theirs stays. Many small drops may leave no clear place beside them, by
which to tell detail that stays from chance. Pixels that hardly change count as drops, too (`still_pixels`). So do those
where a network predicts drops that stay (`staying_drops`): few photographs hardly show what stays.

What the photographs cannot tell: L without drop_alpha would be a stain of light that any scene could lose to the lens.
So L is at most drop_alpha times white or its negative, and drop_alpha is 0 where the slope is near one. Drops grow and
run: lines are fitted at a few times of the capture (see `time_knots`).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from baselines.splatting.kernels.buffer_pool import BufferPool
from deraings.image_planes import Plane, resized, shown_beside, smooth_rise, surroundings, wholly_shown, within_side
from deraings.rain_model.drops_kernels import SUMS, add_view, fit_lines
from deraings.rain_model.fixed_pattern import fixed_pattern
from deraings.rain_model.layer_kernels import behind_drops, shade
from deraings.rain_model.still_pixels import still_cover
from deraings.rain_model.time_knots import count_time_knots, time_weights, views_near
from hydroviews.scene.images import Image

HALF = np.float32(0.5)
MIN_WINDOW, MAX_WINDOW = 4, 32  # views that running means remember


@dataclass(frozen=True)
class LensDropsConfig:
    """How drops are found.

    Numbers without a source were chosen on courtyard and LLFF flower (docs/experiments/2026-11-rain-model.md).

    Attributes:
        long_side: pixels, at least 1, of the planes in which drops are looked for.
        views_per_knot: views, at least 1, that drops at one time are learned from; fewer views have fewer knots.
        max_time_knots: times at which drops may differ, at least 1.
        every: iterations, at least 1, to a view that is added to the sums. They remember as many views either way; with
            2 an objective's step takes a twentieth less than with 1.
        min_views: fewer views do not show what is usual at a place of the lens; no drops are looked for then.
        start: share of the iterations, [0, 1), before renders are seen through drops. 0.05 is best of 0.025 to 0.2:
            earlier, views are not learned yet; later, they have been learned with the drops in them.
        noise: standard deviation of renders, encoded, positive; where they vary less, slopes are drawn to one.
        clear: drop_alpha, [0, 1], up to which the lens counts as clear: on clear lenses slopes spread by 0.03.
        wet: drop_alpha, above `clear`, from which the lens counts for what it is.
        min_share: share of the lens, [0, 1], more than half covered, from which there are any drops. Without drops it
            is 0.0034 at most while the scene is learned, 0.001 in the end; light ones cover 0.04 and more.
        max_share: share of the lens, [0, 1], that may be more than half covered: some of it must show the scene.
        hidden: drop_alpha, above `shown`, from which a pixel does not count in the loss.
        shown: drop_alpha, [0, 1), up to which a pixel counts in full.
        usual: excess of the fixed pattern, from 1, up to which a place shows no drop.
        fixed: the same, above `usual`, from which the line is believed.
    """

    long_side: int = 400
    views_per_knot: int = 12
    max_time_knots: int = 3
    every: int = 2
    min_views: int = 6
    start: float = 0.05
    noise: float = 0.04
    clear: float = 0.1
    wet: float = 0.25
    min_share: float = 0.01
    max_share: float = 0.6
    hidden: float = 0.75
    shown: float = 0.3
    usual: float = 1.3
    fixed: float = 1.8


class DropLayer(NamedTuple):
    """The drops on the lens in one view."""

    alpha: Plane  # drop_alpha [H, W] in [0, 1]
    light: Image  # L [H, W, 3], sRGB-encoded, in [-alpha, alpha]
    shown: float  # drop_alpha up to which a pixel counts in full in the loss, and
    hidden: float  # from which it does not

    def forward(self, image: Image, buffers: BufferPool) -> tuple[Image, Plane]:
        """A view [H, W, 3] as it is seen through the drops, and factors [H, W] on each pixel's share of the loss.

        Both are buffers.
        """
        seen = buffers.array("behind_drops", image.shape)
        weights = buffers.array("drop_weights", self.alpha.shape)
        shown, hidden = np.float32(self.shown), np.float32(self.hidden)
        behind_drops(image, self.alpha, surroundings(image), self.light, shown, hidden, seen, weights)
        return seen, weights

    def backward(self, gradient: Image, buffers: BufferPool) -> Image:
        """The gradient by the view [H, W, 3], a buffer, from that by what `forward` returned.

        What drops show of the surroundings teaches the scene nothing.
        """
        by_view = buffers.array("g_behind_drops", gradient.shape)
        shade(gradient, self.alpha, by_view)
        return by_view


class LensDrops:
    """Running sums by place on the lens, and the drops that follow."""

    def __init__(
        self,
        pictures: Sequence[NDArray[np.uint8]],
        iterations: int,
        config: LensDropsConfig,
        hidden: Sequence[NDArray[np.bool_] | None] = (),
    ) -> None:
        """A lens of which only the fixed pattern is known.

        Args:
            pictures: [H, W, 3] each, in order of name; the first one's size is the lens's.
            iterations: of the training.
            config: settings.
            hidden: masks [H, W] of pixels that are not looked at.
        """
        n_views = len(pictures)
        self._config, self._n_views = config, n_views
        self._first = config.start * iterations
        times = count_time_knots(n_views, config.views_per_knot, config.max_time_knots)
        self._window = max(MIN_WINDOW, min(MAX_WINDOW, n_views // times))
        self._size = height, width = within_side((pictures[0].shape[0], pictures[0].shape[1]), config.long_side)
        self.sums = np.zeros((times, height, SUMS, width), np.float32)
        masks = tuple(hidden) or (None,) * n_views
        self._known = np.logical_or.reduce([shown_beside(mask, self._size) for mask in masks])
        stays = smooth_rise(fixed_pattern(pictures, masks, self._size, times), config.usual, config.fixed)
        self._believed = np.maximum(stays, [self._still(pictures, masks, time) for time in range(times)])

    def _still(
        self, pictures: Sequence[NDArray[np.uint8]], masks: Sequence[NDArray[np.bool_] | None], time: int
    ) -> Plane:
        """The share of each pixel of the lens [h, w] that hardly changes in the views about a time."""
        near = views_near(time, self._n_views, len(self.sums))
        small = (cv2.resize(pictures[view], self._size[::-1], interpolation=cv2.INTER_AREA) for view in near)
        hidden = [~shown_beside(masks[view], self._size) for view in near]
        return still_cover([np.asarray(picture, np.uint8) for picture in small], hidden)

    def believe(self, hidden: Sequence[Plane]) -> None:
        """Believe lines where a network sees drops that stay, too.

        Args:
            hidden: what they hide of the lens about the time of each view, [h, w] in [0, 1].
        """
        seen, total = np.zeros_like(self._believed), np.zeros(len(self.sums), np.float32)
        for view, plane in enumerate(hidden):
            weights = time_weights(view, self._n_views, len(self.sums))
            seen += weights[:, None, None] * resized(plane, self._size)
            total += weights
        self._believed = np.maximum(self._believed, seen / total[:, None, None])

    @property
    def staying(self) -> float:
        """Share of the lens that shows detail which stays, at any time, of what any photograph shows of the lens."""
        believed = self._believed[:, self._known]
        return float((believed > HALF).mean()) if believed.size else 0.0

    @property
    def size(self) -> tuple[int, int]:
        """Height and width that drops are kept at."""
        return self._size

    def due(self, iteration: int) -> bool:
        """Whether to add a view in this step."""
        return iteration % self._config.every == 0

    def update(self, photograph: Image, seen: Image, view: int, shown: Plane | None = None) -> None:
        """Add a view to the sums.

        Args:
            photograph: [H, W, 3].
            seen: its render [H, W, 3], seen through mist and falling rain but not through drops.
            view: index of the view.
            shown: [H, W]; where it is not 1 the view is left out. By default it is 1 everywhere.
        """
        size = self._size
        whole = wholly_shown(shown, size)
        small = [
            np.ascontiguousarray(
                image if image.shape[:2] == size else cv2.resize(image, size[::-1], interpolation=cv2.INTER_AREA),
                np.float32,
            )
            for image in (photograph, seen)
        ]
        around = surroundings(small[1])
        for time, weight in enumerate(time_weights(view, self._n_views, len(self.sums))):
            if weight > 0:
                keep = np.float32(1 - weight / self._window)
                add_view(*small, around, whole, keep, weight, self.sums[time])

    def line(self, view: int) -> tuple[Plane, Image]:
        """drop_alpha [h, w] and L [h, w, 3] at a view's time; 0 where nothing is known."""
        config, size = self._config, self._size
        weights = time_weights(view, self._n_views, len(self.sums))
        alpha, light = np.empty(size, np.float32), np.empty((*size, 3), np.float32)
        noise, clear, wet = (np.float32(value) for value in (config.noise, config.clear, config.wet))
        believed = np.tensordot(weights, self._believed, 1)
        fit_lines(self.sums, weights, believed, noise, clear, wet, alpha, light)
        return alpha, light

    def layer(self, view: int, size: tuple[int, int], iteration: int) -> DropLayer | None:
        """The drops in a view, at any size (height, width); None where there are none."""
        config = self._config
        if iteration < self._first or self._n_views < config.min_views:
            return None
        alpha, light = self.line(view)
        share = float((alpha > HALF).mean())
        if share < config.min_share:
            return None
        if share > config.max_share:
            # a scene that is not learned yet, or water all over: part of the lens must go on teaching
            alpha = np.maximum(alpha - (np.quantile(alpha, 1 - config.max_share) - HALF), 0).astype(np.float32)
            light = np.minimum(light, alpha[..., None])
        if alpha.shape != size:
            alpha = resized(alpha, size)
            light = np.asarray(cv2.resize(light, size[::-1], interpolation=cv2.INTER_LINEAR), np.float32)
        return DropLayer(alpha, light, config.shown, config.hidden)

    def state_dict(self) -> dict[str, NDArray]:
        """The sums, for checkpoints."""
        return {"rows": self.sums}

    def load_state_dict(self, arrays: dict[str, NDArray]) -> None:
        """Take back what `state_dict` returned."""
        self.sums = arrays["rows"].copy()
