"""SpotLessSplats with an eye on the lens: ours, to tell what the features lack where drops are in the way.

Beside the features, the network sees the mean residual of the views taken before and after, at the same place of the
lens: drops stay there while the scene moves on. It is what `deraings` lets its masks see.
"""

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from baselines.distractors.spotless import Spotless
from baselines.masking.feature_network import FeatureMask, MaskNetwork
from baselines.masking.residuals import BINS
from baselines.masking.trimmed import TrimConfig
from baselines.method import Citation
from baselines.splatting.config import TrainerConfig
from baselines.training.checkpoints import below, prefixed
from baselines.training.images import TrainingImages
from deraings.image_planes import Plane, resized
from deraings.lens.views import AROUND, mean_around
from hydroviews.scene.masks import Ignored

LENS = "lens"  # of names in a checkpoint


class LensMask(FeatureMask):
    """SpotLessSplats' mask; remembers the last residuals of all views."""

    extra: ClassVar[int] = 1

    def __init__(
        self, images: TrainingImages, trim: TrimConfig, splatting: TrainerConfig, network: MaskNetwork, seed: int
    ) -> None:
        super().__init__(images, trim, splatting, network, seed)
        self._residuals: dict[int, Plane] = {}  # last ones of views, at the size of their features

    def probability(self, residuals: Plane, view: int, ignored: Ignored | None) -> Plane:
        """See TrimmedPixels; the residuals are remembered for the other views."""
        p = super().probability(residuals, view, ignored)
        shown = residuals if ignored is None else np.where(ignored, np.float32(self._limit), residuals)  # says nothing
        self._residuals[view] = resized(shown, self.network.size(view))
        return p

    def context(self, view: int) -> Sequence[Plane]:
        """log2 of the others' mean residual over the inliers' limit; 0 while there are none."""
        size, limit = self.network.size(view), self._limit
        others = {other: known for other, known in self._residuals.items() if other != view}
        mean = mean_around(view, others, size, AROUND)
        return [np.zeros(size, np.float32) if mean is None else np.log2((mean + limit) / (2 * limit), dtype=np.float32)]

    @property
    def _limit(self) -> float:
        """The largest residual of an inlier."""
        return (self.histogram.percentile(self.trim.inlier_share) + 1) / BINS

    def state_dict(self) -> dict[str, NDArray]:
        """See PixelWeights."""
        return super().state_dict() | prefixed(LENS, {str(view): plane for view, plane in self._residuals.items()})

    def load_state_dict(self, arrays: dict[str, NDArray]) -> None:
        """See PixelWeights."""
        super().load_state_dict(arrays)
        self._residuals = {int(view): plane for view, plane in below(LENS, arrays).items()}


class SpotlessLens(Spotless):
    """SpotLessSplats; the network also receives residuals of other views at the same place of the lens."""

    citation = Citation(
        title="SpotLessSplats with residuals of the lens (this project)",
        paper="SpotLessSplats: Ignoring Distractors in 3D Gaussian Splatting",
        authors="S. Sabour, L. Goli, G. Kopanas, M. Matthews, D. Lagun, L. Guibas, A. Jacobson and others",
        year=2025,
        link="https://arxiv.org/abs/2406.20055",
    )

    mask: ClassVar[type[FeatureMask]] = LensMask
