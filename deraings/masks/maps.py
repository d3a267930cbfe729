"""Planes in blocks of the mask network, and what the losses of many views say about the lens."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from deraings.image_planes import Plane, resized
from deraings.lens.views import by_shape

BLUR = 3.0  # pixels of the network's resolution: coarser features of a loss are no sign of drops


def evidence(losses: Sequence[Plane]) -> float:
    """The share of the fine detail of views' losses that is the same in all of them, place by place on the lens.

    The intraclass correlation of places (Shrout and Fleiss 1979), which does not depend on the number of views: about 0
    where views have nothing in common, as when it is dry or rain falls in front of the lens, and 1 where they are
    alike; 0 for fewer than two views.

    Args:
        losses: of views, [h, w] each; of several shapes the commonest counts.
    """
    if len(losses) < 2:
        return 0.0
    alike = [losses[number] for number in by_shape([loss.shape for loss in losses])[0]]
    same = [resized(loss, alike[0].shape) for loss in alike]
    fine = np.stack([loss - cv2.GaussianBlur(loss, (0, 0), BLUR) for loss in same])
    within = float(fine.var(axis=0, ddof=1).mean())
    common = max(0.0, float(fine.mean(axis=0).var()) - within / len(fine))
    return common / max(common + within, 1e-12)


def filled(plane: NDArray, block: int) -> NDArray:
    """[H, W, ...] with its last row and column repeated until both sides are multiples of `block`."""
    height, width = plane.shape[:2]
    return cv2.copyMakeBorder(plane, 0, -height % block, 0, -width % block, cv2.BORDER_REPLICATE)
