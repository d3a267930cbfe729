"""How far a render is from its photograph, and which of the residuals are the scene's.

Trimmed least squares (Sabour et al. 2023, RobustNeRF, section 4): distractors have the largest residuals, so a pixel
is an inlier if its residual is below a percentile of the last views' residuals, or if most of its neighbours' are,
since fine detail is learned late and stands alone while distractors are connected. The percentile is read from a
histogram that forgets (Sabour et al. 2025, SpotLessSplats, section 4.2).

A residual counts as below the percentile if its bin is: the authors compare with the bin's lower edge, by which nothing
would be an inlier where all residuals are one number, as in a picture of one grey.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from baselines.splatting.kernels.photometric import Plane, Target
from hydroviews.scene.images import Image
from hydroviews.scene.masks import Ignored

BINS = 10_000  # of residuals in [0, 1]
NEIGHBOURHOOD = (3, 3)
MAJORITY = 0.5


def residuals_of(image: Image, target: Target) -> Plane:
    """mean over channels of |C^ - C|, [H, W] in [0, 1]; 1 where the render is not finite."""
    difference = np.abs(image - target.image)
    red, green, blue = np.moveaxis(difference, 2, 0)
    found = (red + green + blue) / np.float32(3)  # numpy's mean takes ten times as long along so short an axis
    return np.minimum(np.where(np.isfinite(found), found, np.float32(1)), np.float32(1))


def bins_of(residuals: Plane) -> NDArray[np.int64]:
    """The number of each residual's bin, in [0, BINS)."""
    return np.minimum((residuals * np.float32(BINS)).astype(np.int64), BINS - 1)


class ResidualHistogram:
    """Counts of the residuals of the last views; those of a view are worth `memory` times as much after each other."""

    def __init__(self, memory: float) -> None:
        self.memory = memory
        self.counts = np.zeros(BINS)

    def observe(self, residuals: Plane, ignored: Ignored | None = None) -> None:
        """Count a view's residuals [H, W], but for those of hidden pixels."""
        shown = residuals if ignored is None else residuals[~ignored]
        self.counts = self.memory * self.counts + np.bincount(bins_of(shown).ravel(), minlength=BINS)

    def percentile(self, share: float) -> int:
        """The first bin up to which at least this share of the counts lies; the last one before anything is counted."""
        cumulative = np.cumsum(self.counts)
        if not cumulative[-1] > 0:
            return BINS - 1
        return int(np.searchsorted(cumulative, share * cumulative[-1]).clip(max=BINS - 1))


def inliers(residuals: Plane, last_bin: int, ignored: Ignored | None = None) -> NDArray[np.bool_]:
    """Residuals [H, W] in bins up to the last one, and those most of whose 3x3 neighbours that are shown are there."""
    below = bins_of(residuals) <= last_bin
    shown = np.ones(below.shape, np.float32) if ignored is None else (~ignored).astype(np.float32)
    votes, voters = (
        cv2.boxFilter(plane, -1, NEIGHBOURHOOD, normalize=False, borderType=cv2.BORDER_CONSTANT)
        for plane in (below * shown, shown)
    )
    return below | (votes > MAJORITY * voters)
