"""The probability r that drops hide a pixel of a view: one quantity, from two kinds of evidence.

    pi  = p + (1 - s) (1 - p) q
    r   = c pi / (c pi + 1 - pi);  a pixel's share of the loss is 1 - r

* q is what a network predicts that drops cover of the pixel in this view.
* p is the same of what stays on the lens: the mean q of the views about this time, with the weight of `pseudo_views`
  beside the lines of `drops`, which see through what they find, and hide nothing:  p = kappa q_mean / (kappa + n).
* s is the share of the cover that recurs, the slope of q in q_mean over the pixels of all views: 1 where drops stay,
  0 where drops are new in every view, or where the network takes things in the scene for drops.
* c is what learning a drop costs, in units of a pixel that is left out.
"""

from functools import cached_property

import numpy as np

from deraings.enhancement.views import EnhancedViews
from deraings.image_planes import Plane, resized
from deraings.rain_model.config import OcclusionConfig

MOST = 0.95  # pi up to which pixels are hidden: what is hidden in all views is learned all the same
LEAST_WET = 0.01  # cover: mean of a wet lens, 0.07 and more in development scenes (0.0001 of dry ones); pi of a drop


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
        """q_mean [h, w] about the time of a view, of the other views of its lens; q where drops are new in each."""
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
        """pi [H, W] of a view at (height, width), a new plane, with lines of drops fitted to `n_lines` views."""
        config, s = self._config, np.float32(self.recurring)
        p = resized(self.mean_cover(view), size) * np.float32(config.pseudo_views / (config.pseudo_views + n_lines))
        return p if s == 1 else p + (1 - s) * (1 - p) * resized(self._network.small_drop_cover(view), size)

    def shown(self, view: int, size: tuple[int, int], n_lines: float) -> Plane | None:
        """1 - r [H, W], factors on each pixel's share of the loss; None where no pixel may be a drop's.

        Args:
            view: index of the view.
            size: its height and width.
            n_lines: as of `prior`.
        """
        pi = self.prior(view, size, n_lines)
        if pi.max() < LEAST_WET:
            return None
        np.minimum(pi, np.float32(MOST), out=pi)
        return (1 - pi) / (1 + np.float32(self._config.cost - 1) * pi)
