"""Planes in blocks of the mask network, and what the losses of many views say about the lens."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from deraings.image_planes import Plane, resized

BLUR = 3.0  # pixels of the network's resolution: coarser features of a loss are no sign of drops


def evidence(losses: Sequence[Plane]) -> float:
    """How much more alike the fine detail of views' losses is, place by place on the lens, than by chance.

    The variance, over the lens, of the mean over n views, times n, over the variance of a single view about that mean:
    about 1 where views have nothing in common, as when it is dry or rain falls in front of the lens; 0 for fewer than
    two views.

    Args:
        losses: of views, [h, w] each; others than the first are brought to its size.
    """
    if len(losses) < 2:
        return 0.0
    size = losses[0].shape
    fine = np.stack([loss - cv2.GaussianBlur(loss, (0, 0), BLUR) for loss in (resized(x, size) for x in losses)])
    return float(len(fine) * fine.mean(axis=0).var() / max(float(fine.var(axis=0, ddof=1).mean()), 1e-12))


def filled(plane: NDArray, block: int) -> NDArray:
    """[H, W, ...] with its last row and column repeated until both sides are multiples of `block`."""
    height, width = plane.shape[:2]
    return cv2.copyMakeBorder(plane, 0, -height % block, 0, -width % block, cv2.BORDER_REPLICATE)
