"""Pixels of the lens that hardly change from view to view: small drops with light of their own, from photographs alone.

Water that shows little of the scene keeps its value while the scene moves behind the lens. A share c of a pixel that it
covers takes as much from the standard deviation s over the views,

    s = (1 - c) s_around,    s_around = G(w s) / G(w),    w = (1 - c)^2,

where G is a Gaussian and pixels beside the drop, behind the same mist, say what the scene does there. A few rounds find
c and the weights together. Large drops that refract the scene change with it, and are not found here.
"""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from deraings.image_planes import Plane

AROUND = 1 / 20  # longer sides, standard deviation of G
ROUNDS = 3
NOISE = 0.02  # encoded, added to both deviations: what is still everywhere says nothing
MIN_VIEWS = 6  # fewer do not show what a pixel does
LEAST_WEIGHT = 1e-3


def still_cover(pictures: Sequence[NDArray[np.uint8]], hidden: Sequence[NDArray[np.bool_] | None] = ()) -> Plane:
    """c [H, W] in [0, 1], the share of each pixel that hardly changes; 0 where fewer than MIN_VIEWS show it.

    Args:
        pictures: [H, W, 3] each, of one size and about one time.
        hidden: masks [H, W] of pixels that do not count, one a picture; none by default.
    """
    masks = tuple(hidden) or (None,) * len(pictures)
    size = pictures[0].shape[:2]
    sums, squares, count = np.zeros((*size, 3)), np.zeros((*size, 3)), np.zeros((*size, 1))
    for picture, mask in zip(pictures, masks, strict=True):
        shown = np.ones((*size, 1)) if mask is None else ~mask[..., None]
        values = picture / 255 * shown
        sums, squares, count = sums + values, squares + values**2, count + shown
    known = count[..., 0] >= MIN_VIEWS
    total = np.maximum(count, 1)
    variance = np.maximum(squares / total - (sums / total) ** 2, 0).mean(axis=2)
    deviation = np.where(known, np.sqrt(variance), 0).astype(np.float32)
    return _cover(deviation, known.astype(np.float32), AROUND * max(size))


def _cover(deviation: Plane, known: Plane, sigma: float) -> Plane:
    """c [H, W] from standard deviations and which are known, [H, W] each."""
    cover = np.zeros_like(deviation)
    for _ in range(ROUNDS):
        weights = known * (1 - cover) ** 2
        total = np.maximum(cv2.GaussianBlur(weights, (0, 0), sigma), LEAST_WEIGHT)
        around = cv2.GaussianBlur(weights * deviation, (0, 0), sigma) / total
        cover = known * np.clip(1 - (deviation + NOISE) / (around + NOISE), 0, 1)
    return np.asarray(cover, np.float32)
