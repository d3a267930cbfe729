"""Weights by the residuals: pixels that are far from their photograph are left out (RobustNeRF, SpotLessSplats).

    mask ~ Bernoulli(a + (1 - a) p),      a = exp(-progress / fade_in)

p is the probability of each pixel to be the scene's. Masks fade in: at first all pixels count (Sabour et al. 2025,
SpotLessSplats, section 4.2.2 and their code; the loss is not divided by the share of pixels that count).
"""

import logging
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from baselines.masking.pixel_weights import Comparison, PixelWeights
from baselines.masking.residuals import ResidualHistogram, inliers, residuals_of
from baselines.splatting.config import TrainerConfig
from baselines.splatting.kernels.photometric import Plane, prepare_target
from baselines.splatting.schedule import Stream, random_stream
from baselines.training.images import Size, TrainingImages
from hydroviews.scene.images import Image
from hydroviews.scene.masks import Ignored

logger = logging.getLogger(__name__)

MEMORY = 0.95  # what a view's residuals are worth after another view; the authors'
FEWEST = 0.05  # of the pixels, below which masks are given up: there would be no scene to learn
RECENT = 50  # steps that the share of pixels is averaged over


@dataclass(frozen=True)
class TrimConfig:
    """Which pixels count, and from when on.

    Attributes:
        inlier_share: of the residuals, (0, 1], those taken for the scene's before neighbours are asked; the authors
            have 0.7.
        fade_in: share of the iterations, positive, in which a falls by a factor e; the authors have 500 of 30,000.
    """

    inlier_share: float = 0.7
    fade_in: float = 1 / 60

    def __post_init__(self) -> None:
        if not (0 < self.inlier_share <= 1 and self.fade_in > 0):
            raise ValueError(f"{self}: expected inlier_share in (0, 1], fade_in above 0")


class TrimmedPixels(PixelWeights):
    """1 for inliers of the residuals (RobustNeRF's filter), else 0."""

    def __init__(self, images: TrainingImages, trim: TrimConfig, splatting: TrainerConfig, seed: int) -> None:
        """Count all pixels, until residuals are known.

        Args:
            images: the photographs.
            trim: settings.
            splatting: how the Gaussians are trained; once they have stopped to grow, percentiles stay.
            seed: of what is drawn.
        """
        self.images, self.trim, self.seed = images, trim, seed
        self._iterations, self._observed = splatting.iterations, splatting.strategy.stop
        self.histogram = ResidualHistogram(MEMORY)
        self._counted = np.zeros(2)  # recent share of the pixels that count, and from how many steps it is known
        self.given_up = False

    def weigh(self, seen: Comparison) -> Plane | None:
        """See PixelWeights: 1 for pixels that count in this step, else 0."""
        if self.given_up:
            return None
        residuals, ignored = residuals_of(seen.render(), seen.target), seen.target.ignored
        if seen.iteration < self._observed:
            self.histogram.observe(residuals, ignored)
        weights = self._drawn(self.probability(residuals, seen.view, ignored), seen.iteration)
        self._watch(weights, ignored, seen.iteration)
        return None if self.given_up else weights

    def hidden(self, view: int, size: Size, render: Callable[[], Image]) -> Plane | None:
        """See PixelWeights: 1 - p; None where masks were given up."""
        if self.given_up:
            return None
        target = prepare_target(self.images.pixels(view, size), self.images.ignored(view, size))
        return 1 - self.predicted(residuals_of(render(), target), view, target.ignored)

    def probability(self, residuals: Plane, view: int, ignored: Ignored | None) -> Plane:
        """p [H, W] in [0, 1] of a view's pixels, whose residuals are new; whatever predicts it may learn from them."""
        return self.predicted(residuals, view, ignored)

    def predicted(self, residuals: Plane, view: int, ignored: Ignored | None) -> Plane:
        """p [H, W] of a view's pixels as it is known; here 1 for inliers, else 0."""
        return self.below(residuals, self.trim.inlier_share, ignored).astype(np.float32)

    def below(self, residuals: Plane, share: float, ignored: Ignored | None) -> NDArray[np.bool_]:
        """The inliers [H, W] below a percentile of the last views' residuals."""
        return inliers(residuals, self.histogram.percentile(share), ignored)

    def report(self) -> dict[str, str]:
        """See PixelWeights: the share of pixels that count, or that masks were given up."""
        return {"pixels": "all, masks given up"} if self.given_up else {"pixels": f"{self._counted[0]:.0%}"}

    def state_dict(self) -> dict[str, NDArray]:
        """See PixelWeights."""
        return {
            "histogram": self.histogram.counts,
            "counted": self._counted,
            "given_up": np.array([self.given_up], np.uint8),
        }

    def load_state_dict(self, arrays: dict[str, NDArray]) -> None:
        """See PixelWeights."""
        self.histogram.counts, self._counted = arrays["histogram"].copy(), arrays["counted"].copy()
        self.given_up = bool(arrays["given_up"][0])

    def _drawn(self, probability: Plane, iteration: int) -> Plane:
        a = faded(iteration / self._iterations, self.trim.fade_in)
        draws = random_stream(self.seed, Stream.INLIERS, iteration).random(probability.shape, np.float32)
        return (draws < a + (1 - a) * probability).astype(np.float32)

    def _watch(self, weights: Plane, ignored: Ignored | None, iteration: int) -> None:
        """Follow how many pixels count; masks that leave next to none are given up, with a warning."""
        shown = weights if ignored is None else weights[~ignored]
        if not shown.size:
            return
        share, steps = self._counted
        steps = min(steps + 1, RECENT)
        self._counted = np.array([share + (float(shown.mean()) - share) / steps, steps])
        if steps == RECENT and self._counted[0] < FEWEST:
            self.given_up = True
            logger.warning(
                "training: masks leave %.1f %% of the pixels after %d iterations; from here on all pixels count, "
                "as if there were no masks",
                100 * self._counted[0],
                iteration + 1,
            )


def faded(progress: float, fade_in: float) -> float:
    """a, at a share of the iterations."""
    return math.exp(-progress / fade_in)
