"""The probability r that drops hide a pixel of a view: one quantity, from three kinds of evidence.

    pi  = p + (1 - s) (1 - p) q                            before the render is looked at
    r   = c pi l / (c pi l + 1 - pi)                       after; a pixel's share of the loss is 1 - r

* q is what a network predicts that drops cover of the pixel in this view.
* p is the same of what stays on the lens: the mean q of the views about this time, with the weight of `pseudo_views`
  beside the lines of `drops`, which see through what they find, and hide nothing:  p = kappa q_mean / (kappa + n).
* s is the share of the cover that recurs, the slope of q in q_mean over the pixels of all views: 1 where drops stay,
  0 where drops are new in every view, or where the network takes things in the scene for drops.
* l is the likelihood ratio of the residual e around the pixel, of Laplace distributions of scale b in the open and 2 b
  behind a drop, exp(e / 2 b) / 2 with b from the median of the view. The ratio is at most `trust`: a scene that is not
  learned yet has large residuals, and would never be learned if they counted in full.
* c is what learning a drop costs, in units of a pixel that is left out.
"""

from collections.abc import Callable
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from baselines.splatting.kernels.photometric import Target
from deraings.enhancement.views import EnhancedViews
from deraings.image_planes import Plane, resized
from deraings.rain_model.config import OcclusionConfig
from hydroviews.scene.images import Image

AROUND = 1 / 64  # longer sides of the view, across the square in which residuals are averaged
MOST = 0.95  # probability up to which pixels are hidden: what is hidden in all views is learned all the same
LEAST_SCALE = 1 / 255  # of residuals: what an 8-bit photograph cannot show says nothing
LEAST_SHARE = 1e-3  # of shown pixels around one: what none is known of has no residual
LEAST_WET = 0.01  # cover: mean of a wet lens, 0.07 and more in development scenes (0.0001 of dry ones); pi of a drop
CHANNEL_MEAN = np.full((1, 3), 1 / 3, np.float32)


class Occlusion:
    """What drops hide of each training view, as far as a network predicts it."""

    def __init__(self, network: EnhancedViews, n_views: int, config: OcclusionConfig) -> None:
        """Predict nothing yet.

        Args:
            network: predicts what drops cover of the photographs.
            n_views: how many there are.
            config: settings.
        """
        self._network, self._n_views, self._config = network, n_views, config

    def mean_cover(self, view: int) -> Plane:
        """q_mean [h, w] about the time of a view, of the other views of its lens."""
        return self._network.mean_drop_cover(view)

    def recurring_cover(self, view: int) -> Plane:
        """s q_mean [h, w] about the time of a view: the probability that a drop stays there."""
        return np.float32(self.recurring) * self.mean_cover(view)

    @cached_property
    def recurring(self) -> float:
        """s, the share of the cover that recurs, [0, 1]."""
        products, squares = 0.0, 0.0
        for view in range(self._n_views):
            own, mean = self._network.small_drop_cover(view), self.mean_cover(view)
            deviation = mean - mean.mean()
            products += float((deviation * own).mean())
            squares += float(np.square(deviation).mean())
        return float(np.clip(products / squares, 0, 1)) if squares > 0 else 0.0

    @cached_property
    def wet(self) -> bool:
        """Whether drops are on the lens: they cover LEAST_WET of it in the mean."""
        return bool(np.mean([self.recurring_cover(view).mean() for view in range(self._n_views)]) >= LEAST_WET)

    def prior(self, view: int, size: tuple[int, int], n_lines: float) -> Plane:
        """pi [H, W] of a view at (height, width), with lines of drops fitted to `n_lines` views."""
        config, s = self._config, np.float32(self.recurring)
        p = resized(self.mean_cover(view), size) * np.float32(config.pseudo_views / (config.pseudo_views + n_lines))
        return p if s == 1 else p + (1 - s) * (1 - p) * resized(self._network.small_drop_cover(view), size)

    def shown(self, prior: Plane, target: Target, render: Callable[[], Image]) -> Plane | None:
        """1 - r [H, W], factors on each pixel's share of the loss; None, for 1, where no pixel may be a drop's.

        Args:
            prior: pi [H, W].
            target: the photograph, and what its mask shows.
            render: gives the view [H, W, 3] as it is seen through the rest of the rain, finite.
        """
        if prior.max() < LEAST_WET:
            return None
        pi = np.minimum(prior, np.float32(MOST))
        odds = residual_likelihood(target, render(), self._config.trust)
        odds *= np.float32(self._config.cost) * pi / (1 - pi)
        return np.asarray(1 / (1 + odds), np.float32)


def residual_likelihood(target: Target, seen: Image, trust: float) -> Plane:
    """l [H, W], from residuals averaged over squares of a side of AROUND; within [1/2, trust].

    Hidden pixels are black in the photograph and say nothing.
    """
    side = max(3, round(AROUND * max(seen.shape)) | 1)
    residual, shown = cv2.transform(cv2.absdiff(target.image, seen), CHANNEL_MEAN), target.shown
    if shown is None:
        residual = cv2.blur(residual, (side, side))
        known = residual[::4, ::4]  # one pixel in 16: they are averages
    else:
        shares = np.maximum(cv2.blur(shown, (side, side)), np.float32(LEAST_SHARE))
        residual = cv2.blur(residual * shown, (side, side)) / shares
        known = residual[::4, ::4][shown[::4, ::4] > 0]
    scale = max(float(np.median(known)) / np.log(2) if known.size else 0.0, LEAST_SCALE)
    ratio: NDArray[np.float32] = np.exp(np.minimum(residual / np.float32(2 * scale), np.float32(np.log(2 * trust)))) / 2
    return ratio
