"""The photometric loss over what is taken for the scene: what `robust-filter` and `spotless` share.

    mask ~ Bernoulli(a + (1 - a) p),      a = exp(-progress / fade_in)

p is the probability of each pixel to be the scene's. Masks fade in: at first all pixels count (Sabour et al. 2025,
SpotLessSplats, section 4.2.2 and their code; the loss is not divided by the share of pixels that count).
"""

import logging
import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from baselines.distractors.residuals import ResidualHistogram, inliers, residuals_of
from baselines.gaussian_splatting import GaussianSplatting
from baselines.splatting.config import TrainerConfig
from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.kernels.photometric import Plane
from baselines.splatting.objective import Objective
from baselines.splatting.schedule import Stream, random_stream
from baselines.training.images import Size, TrainingImages
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import Image
from hydroviews.scene.masks import Ignored
from hydroviews.scene.scenes import Scene

logger = logging.getLogger(__name__)

FEWEST = 0.05  # of the pixels, below which masks are given up: there would be no scene to learn
RECENT = 50  # steps that the share of pixels is averaged over


@dataclass(frozen=True)
class TrimConfig:
    """Which pixels count, and from when on.

    Attributes:
        inlier_share: of the residuals, (0, 1], those taken for the scene's before neighbours are asked; the authors
            have 0.7.
        memory: what a view's residuals are worth after another view, [0, 1); the authors'.
        fade_in: share of the iterations, positive, in which a falls by a factor e; the authors have 500 of 30,000.
    """

    inlier_share: float = 0.7
    memory: float = 0.95
    fade_in: float = 1 / 60

    def __post_init__(self) -> None:
        if not (0 < self.inlier_share <= 1 and 0 <= self.memory < 1 and self.fade_in > 0):
            raise ValueError(f"{self}: expected inlier_share in (0, 1], memory in [0, 1), fade_in above 0")


class HoldsSplatting(Protocol):
    """Settings of a method of this folder."""

    @property
    def splatting(self) -> TrainerConfig:
        """How the Gaussians are trained."""

    @property
    def trim(self) -> TrimConfig:
        """Which pixels count."""


class TrimmedObjective(Objective):
    """The photometric loss over the inliers of the residuals (RobustNeRF's filter)."""

    def __init__(self, images: TrainingImages, config: HoldsSplatting, seed: int) -> None:
        super().__init__(images, config.splatting.lambda_dssim)
        self.trim, self.seed = config.trim, seed
        self._iterations = config.splatting.iterations
        self._observed = config.splatting.strategy.stop  # iterations; later residuals do not move the percentiles
        self.histogram = ResidualHistogram(config.trim.memory)
        self._counted = np.zeros(2)  # recent share of the pixels that count, and from how many steps it is known
        self.given_up = False

    def weights(
        self, render: Callable[[], Image], view: int, size: Size, iteration: int, buffers: BufferPool
    ) -> Plane | None:
        """See Objective: 1 for pixels that count in this step, else 0."""
        if self.given_up:
            return None
        target = self.target(view, size)
        residuals = residuals_of(render(), target)
        if iteration < self._observed:
            self.histogram.observe(residuals, target.ignored)
        weights = self._drawn(self.probability(residuals, view, target.ignored), iteration)
        self._watch(weights, target.ignored, iteration)
        return None if self.given_up else weights

    def left_out(self, image: Image, view: int) -> Plane | None:
        """1 - p [H, W] of a view whose render this is, learning nothing; None where masks were given up."""
        target = self.target(view, (image.shape[0], image.shape[1]))
        return None if self.given_up else 1 - self.predicted(residuals_of(image, target), view, target.ignored)

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
        """See Objective: the share of pixels that count, or that masks were given up."""
        return {"pixels": "all, masks given up"} if self.given_up else {"pixels": f"{self._counted[0]:.0%}"}

    def settings(self) -> dict[str, Any]:
        """See Objective."""
        return {**super().settings(), **asdict(self.trim), "iterations": self._iterations, "seed": self.seed}

    def state_dict(self) -> dict[str, NDArray]:
        """See Objective."""
        own: dict[str, NDArray] = {
            "histogram": self.histogram.counts,
            "counted": self._counted,
            "given_up": np.array([self.given_up], np.uint8),
        }
        return super().state_dict() | own

    def load_state_dict(self, arrays: dict[str, NDArray]) -> None:
        """See Objective."""
        super().load_state_dict(arrays)
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


class TrimmedMethod(GaussianSplatting):
    """Splatting on what is taken for the scene; it can say of its training views what it leaves out."""

    _objective: TrimmedObjective | None
    _cameras: tuple[Camera, ...] = ()  # of the training views

    def fit(self, scene: Scene, folder: Path) -> None:
        """See Method."""
        super().fit(scene, folder)
        self._cameras = tuple(view.camera for view in scene.train_views)

    def hidden(self, view: int, size: Size) -> Plane | None:
        """See Method: 1 - p, for the trained scene."""
        if self._objective is None:
            return None
        return self._objective.left_out(self.render(self._cameras[view].resized(size[1], size[0])), view)
