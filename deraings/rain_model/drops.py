"""Drops that stay on the lens: what they block of the scene and what they add, from how photographs follow the render.

A drop that covers the share drop_alpha of a pixel leaves 1 - drop_alpha of what lies behind, and shows much of the
scene at once instead, out of focus: light that follows that of its surroundings C, the mean render around the drop,
and light of the drop's own. Over the views, a pixel of the lens is therefore a line,

    photograph - C = (1 - drop_alpha) (render - C) + L,

whose slope is the covariance of both differences over the variance of the render's. (With L alone, drops that cover all
had slopes of 0.1 to 0.6: where a view is light, so are the drops in the view.) Where the lens is clear the slope is
one, whatever the scene: what is hard to render makes the render smoother, not the photograph less like it. Bright
texture, white walls and fog move over the lens and are followed like everything else that lies in space. The render is
compared as it is seen through the drops, so that partly covered pixels still teach the scene.

drop_alpha is the line's, times the probability that something stays at this place of the lens. Where the scene is not
learned, or learned wrong, photographs do not follow the render either: trees in wind have slopes like drops, and what
is taken for a drop is never learned afterwards. But no detail of theirs stays (`fixed_pattern`), they change from view
to view (`still_pixels`), and a network that predicts drops in single photographs predicts none in the same place of
the other views.

What the photographs cannot tell: L without drop_alpha would be a stain of light that any scene could lose to the lens.
So L is at most drop_alpha times white or its negative. Drops grow and run: lines are fitted at a few times of the
capture (`time_knots`). Each shape of photographs has a lens of its own: a lens that is turned shows its drops in other
places.
"""

import logging
from collections.abc import Callable, Sequence
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from baselines.splatting.kernels.buffer_pool import BufferPool
from deraings.image_planes import Plane, resized, shown_beside, smooth_rise, surroundings, wholly_shown, within_side
from deraings.lens.fixed_pattern import fixed_pattern
from deraings.lens.still_pixels import still_cover
from deraings.lens.time_knots import count_time_knots, time_weights, views_near
from deraings.lens.views import by_shape
from deraings.rain_model.config import DropsConfig
from deraings.rain_model.kernels import SEEN, SUMS, add_view, behind_drops, fit_lines, shade
from hydroviews.scene.images import Image

logger = logging.getLogger(__name__)

MIN_WINDOW, MAX_WINDOW = 4, 32  # views that running means remember
CLEAR, WET = (
    np.float32(0.1),
    np.float32(0.25),
)  # drop_alpha up to which the lens counts as clear, and from which for what it is


class DropLayer(NamedTuple):
    """The drops on the lens in one view."""

    alpha: Plane  # drop_alpha [H, W] in [0, 1]
    light: Image  # L [H, W, 3], sRGB-encoded, in [-alpha, alpha]

    def forward(self, image: Image, buffers: BufferPool) -> Image:
        """A view [H, W, 3] as it is seen through the drops, a buffer."""
        seen = buffers.array("behind_drops", image.shape)
        behind_drops(image, self.alpha, surroundings(image), self.light, seen)
        return seen

    def backward(self, gradient: Image, buffers: BufferPool) -> Image:
        """The gradient by the view [H, W, 3], a buffer, from that by what `forward` returned.

        What drops show of the surroundings teaches the scene nothing.
        """
        by_view = buffers.array("g_behind_drops", gradient.shape)
        shade(gradient, self.alpha, by_view)
        return by_view


class Drops:
    """The drops on the lenses of all views: running sums by place on the lens, and the lines that follow."""

    def __init__(
        self,
        pictures: Sequence[NDArray[np.uint8]],
        config: DropsConfig,
        hidden: Sequence[NDArray[np.bool_] | None] = (),
        covers: Callable[[int], Plane] | None = None,
    ) -> None:
        """Lenses of which only the photographs are known; logs how many there are.

        Args:
            pictures: [H, W, 3] each, in order of name.
            config: settings.
            hidden: masks [H, W] of pixels that are not looked at.
            covers: the mean cover [h, w] by drops, [0, 1], that a network predicts for the lens about a view's time.
        """
        masks = tuple(hidden) or (None,) * len(pictures)
        shapes = by_shape([picture.shape[:2] for picture in pictures])
        if len(shapes) > 1:
            counts = ", ".join(str(len(views)) for views in shapes)
            logger.info("photographs of %d shapes (%s): each has drops of its own", len(shapes), counts)
        self._config = config
        self.lenses = [
            _Lens(
                [pictures[v] for v in views],
                config,
                [masks[v] for v in views],
                None if covers is None else [covers(v) for v in views],
            )
            for views in shapes
        ]
        self._places = {view: (n, place) for n, views in enumerate(shapes) for place, view in enumerate(views)}

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
        lens, place = self._places[view]
        self.lenses[lens].update(photograph, seen, place, shown)

    def size(self, view: int) -> tuple[int, int]:
        """Height and width of the lens as a view's drops are kept."""
        return self.lenses[self._places[view][0]].size

    def layer(self, view: int, size: tuple[int, int]) -> DropLayer:
        """The drops in a view, at any size (height, width)."""
        lens, place = self._places[view]
        alpha, light = self.lenses[lens].line(place)
        if alpha.shape != size:
            alpha = resized(alpha, size)
            light = np.asarray(cv2.resize(light, size[::-1], interpolation=cv2.INTER_LINEAR), np.float32)
        return DropLayer(alpha, light)

    def views_added(self, view: int) -> float:
        """How many independent views the drops of a view have been fitted to: at most as many as there are."""
        lens, place = self._places[view]
        return self.lenses[lens].views_added(place)

    def state_dict(self) -> dict[str, NDArray]:
        """The sums of all lenses, for checkpoints."""
        return {str(number): lens.sums for number, lens in enumerate(self.lenses)}

    def load_state_dict(self, arrays: dict[str, NDArray]) -> None:
        """Take back what `state_dict` returned."""
        for number, lens in enumerate(self.lenses):
            lens.sums = arrays[str(number)].copy()


class _Lens:
    """The views of one shape, numbered by themselves."""

    def __init__(
        self,
        pictures: Sequence[NDArray[np.uint8]],
        config: DropsConfig,
        masks: Sequence[NDArray[np.bool_] | None],
        covers: Sequence[Plane] | None,
    ) -> None:
        self._config, self._n_views = config, len(pictures)
        times = count_time_knots(self._n_views)
        self._window = max(MIN_WINDOW, min(MAX_WINDOW, self._n_views // times))
        self.size = height, width = within_side((pictures[0].shape[0], pictures[0].shape[1]), config.long_side)
        self.sums = np.zeros((times, height, SUMS, width), np.float32)
        stays = smooth_rise(fixed_pattern(pictures, masks, self.size, times), config.usual, config.fixed)
        sources = [stays, np.stack([self._still(pictures, masks, time) for time in range(times)])]
        if covers is not None:
            sources.append(np.stack([self._mean_near(covers, time) for time in range(times)]))
        self._stays = np.maximum.reduce(sources)  # probability that something stays [T, h, w]

    def _mean_near(self, covers: Sequence[Plane], time: int) -> Plane:
        near = views_near(time, self._n_views, len(self.sums))
        return np.asarray(np.mean([resized(covers[view], self.size) for view in near], axis=0), np.float32)

    def _still(
        self, pictures: Sequence[NDArray[np.uint8]], masks: Sequence[NDArray[np.bool_] | None], time: int
    ) -> Plane:
        """The share of each pixel of the lens [h, w] that hardly changes in the views about a time."""
        near = views_near(time, self._n_views, len(self.sums))
        small = (cv2.resize(pictures[view], self.size[::-1], interpolation=cv2.INTER_AREA) for view in near)
        hidden = [~shown_beside(masks[view], self.size) for view in near]
        return still_cover([np.asarray(picture, np.uint8) for picture in small], hidden)

    def views_added(self, view: int) -> float:
        """See Drops: the sums of weights grow to the number of views that running means remember."""
        weights = time_weights(view, self._n_views, len(self.sums))
        return float(weights @ self.sums[:, :, SEEN].max(axis=(1, 2)))

    def update(self, photograph: Image, seen: Image, view: int, shown: Plane | None = None) -> None:
        """See Drops."""
        size = self.size
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
        weights = time_weights(view, self._n_views, len(self.sums))
        alpha, light = np.empty(self.size, np.float32), np.empty((*self.size, 3), np.float32)
        fit_lines(self.sums, weights, self._stays, np.float32(self._config.noise), CLEAR, WET, alpha, light)
        return alpha, light
