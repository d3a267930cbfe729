"""Drops that are new in every view: no place of the lens shows them for long, so single photographs must tell of them.

An enhancement network sees drops in a single photograph, and takes some of the scene for drops. The scene as it is
learned from the other views tells the two apart: behind a drop, photograph and render differ. A pixel counts less in
the loss where both say drop,

    weight = 1 - (1 - least) rise(cover sqrt(r / (2 median r))),    r = |photograph - seen| averaged around the pixel,

with the median over the view, so that a scene that is not learned yet hides nothing in particular. What is hidden in
one view is learned from others. A little of every pixel counts: what is taken for a drop in all views, because it is
not learned, weighs alike in all of them then, and Adam learns it nevertheless.

Drops that stay are left to `drops`, which keeps what is seen through their rims: renewed ones are looked for only where
hardly any detail stays on the lens.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from baselines.splatting.kernels.photometric import Target
from baselines.training.images import TrainingImages, evenly_spread
from deraings.enhancement.views import EnhancedViews
from deraings.image_planes import Plane, resized, smooth_rise, within_side
from hydroviews.scene.images import Image, to_uint8

TYPICAL = 2.0  # median residuals of a pixel whose cover is taken as the network has it
LEAST_MEDIAN = 1 / 255  # of residuals: what an 8-bit photograph cannot show says nothing
LEAST_SHARE = 1e-3  # of shown pixels around one: what none is known of has no residual
CHANNEL_MEAN = np.full((1, 3), 1 / 3, np.float32)
BOUNDS = 0.5, 2**0.5  # of what the residual makes of a cover


@dataclass(frozen=True)
class RenewedDropsConfig:
    """When renewed drops are looked for, and what of them is hidden.

    Numbers without a source were chosen on courtyard, LLFF flower and Mip-NeRF 360 bonsai
    (docs/experiments/2026-11-rain-model.md).

    Attributes:
        max_staying: share of the lens, [0, 1], that shows detail which stays, up to which renewed drops are looked for.
            Drops that stay have 0.38 and more, renewed ones 0.17 at most.
        covered: cover, [0, 1], that counts for that of a drop.
        min_share: share of pixels, [0, 1], so covered, from which there are drops. Views without drops have 0.017 at
            most, in haze; renewed drops 0.10 and more.
        sample: photographs, at least 1, that are asked for it.
        start: share of the iterations, [0, 1), before anything is hidden.
        shown: evidence, from 0, up to which a pixel counts in full.
        hidden: evidence, above `shown`, from which it counts least.
        least: what it counts then, [0, 1].
        around: longer sides of the view across the square in which residuals are averaged.
        long_side: pixels, at least 1, of the covers that are kept.
    """

    max_staying: float = 0.25
    covered: float = 0.2
    min_share: float = 0.04
    sample: int = 8
    start: float = 0.05
    shown: float = 0.1
    hidden: float = 0.35
    least: float = 0.2
    around: float = 1 / 64
    long_side: int = 400


class RenewedDrops:
    """Which pixels of which view drops hide that are seen there alone."""

    def __init__(
        self,
        enhanced: EnhancedViews,
        images: TrainingImages,
        staying: float,
        iterations: int,
        config: RenewedDropsConfig,
    ) -> None:
        """Look at a few photographs, if hardly any detail stays on the lens.

        Args:
            enhanced: the photographs as a network sees them that tells what drops cover.
            images: the photographs.
            staying: share of the lens that shows detail which stays.
            iterations: of the training.
            config: settings.
        """
        self._enhanced, self._config = enhanced, config
        self._first = config.start * iterations
        self._covers: dict[int, NDArray[np.uint8]] = {}  # by view, as far as they were asked for
        self.share = self._share(images) if staying <= config.max_staying else 0.0  # of pixels, as the network sees it
        self.wanted = self.share >= config.min_share

    def _share(self, images: TrainingImages) -> float:
        """The share of pixels that the network sees covered, of those shown in a few photographs of all times."""
        shares = []
        for view in evenly_spread(len(images), self._config.sample):
            covered, hidden = self._enhanced.drop_cover(view) > self._config.covered, images.ignored(view)
            shown = covered if hidden is None else covered[~hidden]
            if shown.size:
                shares.append(shown.mean())
        return float(np.mean(shares)) if shares else 0.0

    def cover(self, view: int, size: tuple[int, ...]) -> Plane:
        """What drops cover of each pixel of a view [H, W], as the network has it; 0 where no such drops are."""
        if not self.wanted:
            return np.zeros(size, np.float32)
        if view not in self._covers:
            cover = self._enhanced.drop_cover(view)
            self._covers[view] = to_uint8(resized(cover, within_side(cover.shape, self._config.long_side)))
        return resized(self._covers[view].astype(np.float32) / 255, size)

    def due(self, iteration: int) -> bool:
        """Whether anything is hidden in this iteration."""
        return self.wanted and iteration >= self._first

    def weights(self, target: Target, seen: Image, view: int) -> Plane:
        """Factors [H, W] on each pixel's share of the loss, where something is hidden.

        Args:
            target: the photograph, and what its mask shows.
            seen: its render [H, W, 3], finite, seen through the rest of the rain.
            view: index of the view.
        """
        config = self._config
        agreed = _agreed(target, seen, max(3, round(config.around * max(seen.shape)) | 1))
        hidden = smooth_rise(self.cover(view, seen.shape[:2]) * agreed, config.shown, config.hidden)
        return 1 - np.float32(1 - config.least) * hidden


def _agreed(target: Target, seen: Image, side: int) -> Plane:
    """What residuals, averaged over squares of a side, make of covers [H, W]: a factor within BOUNDS.

    Hidden pixels are black in the photograph and say nothing.
    """
    residual, shown = cv2.transform(cv2.absdiff(target.image, seen), CHANNEL_MEAN), target.shown
    if shown is None:
        residual = cv2.blur(residual, (side, side))
        known = residual[::2, ::2]  # one pixel in four: they are averages
    else:
        shares = np.maximum(cv2.blur(shown, (side, side)), np.float32(LEAST_SHARE))
        residual = cv2.blur(residual * shown, (side, side)) / shares
        known = residual[::2, ::2][shown[::2, ::2] > 0]
    typical = TYPICAL * max(float(np.median(known)) if known.size else 0.0, LEAST_MEDIAN)
    return np.asarray(np.clip(np.sqrt(residual / np.float32(typical)), *BOUNDS), np.float32)
