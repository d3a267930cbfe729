"""Detail that stays on the lens while the scene moves behind it: what drops show and scenes do not.

A drop's rim and what it shines with lie at the same place of the lens in many photographs. Of a scene that moves over
the lens, the gradients at a place point everywhere; their mean over the views is what chance leaves. The share of the
gradients' power that lies in their mean,

    F = sum_around |mean over views of the gradient|^2 / sum_around mean over views of |gradient|^2,

is therefore one over the number of views that show the place, on a clear lens, whether or not the scene can be learned;
measured, sqrt(F) is 0.9 to 1.1 times what that says on captures walked around a scene and on forward-facing ones.
Nothing but the photographs is looked at.
"""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from deraings.image_planes import Plane, shown_beside
from deraings.lens.time_knots import time_weights
from hydroviews.scene.images import Image

AROUND = 1 / 64  # longer sides of the lens, across the square in which gradients are summed
REACH = 1 / 45  # the same, across the square in which the largest excess counts: rims tell of what they enclose
LEAST_SIDE = 3  # pixels, of both
STILL = 0.1  # share of the lens that shows the scene: where even that stays, cameras do not move
NOISE = 0.01  # encoded, standard deviation of a difference of pixels that says nothing


def fixed_pattern(
    pictures: Sequence[NDArray[np.uint8]], hidden: Sequence[NDArray[np.bool_] | None], size: tuple[int, int], knots: int
) -> NDArray[np.float32]:
    """How many times what chance leaves of it sqrt(F) is, at each knot in time [T, h, w], from 0.

    Args:
        pictures: [H, W, 3] each, in order of name.
        hidden: masks [H, W] of pixels that are not looked at, one a picture.
        size: h and w.
        knots: T.
    """
    means = np.zeros((knots, *size, 6), np.float32)  # sums over views of the gradient, three channels across and down
    powers, seen, squares = np.zeros((3, knots, *size), np.float32)  # of power, of weights, of squared weights
    for view, (picture, mask) in enumerate(zip(pictures, hidden, strict=True)):
        slopes = _slopes(_small(picture, size))
        shown = _slopes_shown(shown_beside(mask, size))
        power = np.square(slopes).sum(axis=2)
        for knot, weight in enumerate(time_weights(view, len(pictures), knots)):
            if weight > 0:
                counted = weight * shown
                means[knot] += counted[..., None] * slopes
                powers[knot] += counted * power
                seen[knot] += counted
                squares[knot] += weight * counted
    return np.stack([_excess(*sums) for sums in zip(means, powers, seen, squares, strict=True)])


def _small(picture: NDArray[np.uint8], size: tuple[int, int]) -> Image:
    small = cv2.resize(picture, size[::-1], interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.float32) / np.float32(255)


def _slopes(picture: Image) -> NDArray[np.float32]:
    """Differences of neighbours [h, w, 6], across and down; 0 at the last column and row."""
    across = np.diff(picture, axis=1, append=picture[:, -1:])
    down = np.diff(picture, axis=0, append=picture[-1:])
    return np.concatenate([across, down], axis=2)


def _slopes_shown(shown: NDArray[np.bool_]) -> NDArray[np.float32]:
    """1 where a pixel, its right and its lower neighbour are shown [h, w]: hidden ones are black, so no slope."""
    right, below = np.pad(shown[:, 1:], ((0, 0), (0, 1)), "edge"), np.pad(shown[1:], ((0, 1), (0, 0)), "edge")
    return (shown & right & below).astype(np.float32)


def _excess(mean: NDArray[np.float32], power: Plane, seen: Plane, squares: Plane) -> Plane:
    """sqrt(F) [h, w] over what chance leaves of it, or over what it exceeds nearly everywhere; from sums over views.

    Of gradients that have nothing to do with each other the mean is not quite 0: of their power the sum of the squared
    weights over the square of their sum is left, of more the fewer views show a place.
    """
    side, reach = (max(LEAST_SIDE, round(share * max(seen.shape)) | 1) for share in (AROUND, REACH))
    total = np.maximum(seen, np.float32(1e-6))
    noise = np.float32(mean.shape[2] * NOISE**2)
    fixed = np.square(mean / total[..., None]).sum(axis=2)
    by_chance = squares / np.square(total) * (power / total + noise)
    left = np.maximum(cv2.blur(by_chance, (side, side)), np.float32(1e-12))
    excess = np.sqrt(cv2.blur(fixed, (side, side)) / left)
    known = excess[seen > 0]
    usual = max(1.0, float(np.quantile(known, STILL))) if known.size else 1.0
    return np.asarray(cv2.dilate(excess / np.float32(usual), np.ones((reach, reach), np.uint8)), np.float32)
