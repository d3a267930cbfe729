"""Between drops the photograph knows best: enhanced pictures with the photographs' detail where the lens is clear.

The network alters pixels that nothing covers, and there its picture is further from the truth than the photograph
without its mist. Where drops are, a single picture tells badly: what looks like a drop in the scene moves from view to
view, while drops stay on the lens. So the cover C is the mean of what the network sees in the views before and after:

    w = rise(C),    E' = B + w (E - B) + (1 - w) G((1 - w) (E - B)) / G(1 - w)

with the photograph without mist B, its enhancement E, and a Gaussian G: light that the mist has left is smooth, and the
network's to say. Drops that are new in every view leave no such mean, and streaks lie over all pixels: then nothing is
changed.

Numbers were chosen on courtyard, LLFF flower and Mip-NeRF 360 bonsai (docs/experiments/2026-11-enhancement.md).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from deraings.image_planes import Plane, smooth_rise
from deraings.lens.views import AROUND, mean_around
from hydroviews.scene.images import Image

STREAKS, DROPS = 0, 1  # channels of what rain covers
DROP = 0.5  # mean cover of a place with a drop
MIN_DROPS = 0.01  # share of the lens with drops from which it is wet: 0.06 in light drops, 0 in streaks and dry views
MAX_STREAKS = 0.02  # mean cover by streaks: 0.005 in drops, 0.04 in light streaks
CLEAR, COVERED = 0.2, 0.5  # mean cover up to which the photograph counts alone, and from which the network does
SMOOTH = 1 / 40  # standard deviation of G, in longer sides of the picture
MIN_SHARE = 1e-3  # of clear pixels around one: where there are fewer, G says next to nothing


@dataclass(frozen=True)
class LensCovers:
    """What drops cover of the lens.

    Attributes:
        means: of each place of the lens about the time of each view, [H, W] in [0, 1]: the mean of what is seen in the
            other views; of a photograph of which there is no other, or with new drops, what is seen in it.
        wet: whether drops are on the lens, and no streaks fall.
    """

    means: Sequence[Plane]
    wet: bool


def lens_covers(covers: Sequence[NDArray[np.uint8]], new: Sequence[bool]) -> LensCovers:
    """What drops cover of the lens, from what covers single photographs.

    Args:
        covers: what streaks, drops and mist cover of each photograph [H, W, 3], 255 for all; in order of name.
        new: whether the drops of each photograph are on no other one.
    """
    drops = {view: cover[..., DROPS] for view, cover in enumerate(covers)}
    means: list[Plane] = []
    shares = []
    for view, own in drops.items():
        others = {other: plane for other, plane in drops.items() if other != view}
        mean = mean_around(view, others, own.shape, 0.0 if new[view] else AROUND)
        means.append((own if mean is None else mean) / np.float32(255))
        shares.append(0.0 if mean is None and not new[view] else float(np.mean(means[-1] > DROP)))
    streaks = np.mean([cover[..., STREAKS].mean() / 255 for cover in covers])
    return LensCovers(means, bool(np.mean(shares) >= MIN_DROPS and streaks <= MAX_STREAKS))


def covered(mean: Plane) -> Plane:
    """What of each place of the lens a picture does not show, of the mean cover: w, in [0, 1]."""
    return smooth_rise(mean, CLEAR, COVERED)


def hidden_by_drops(mean: Plane) -> Plane:
    """What of each place of the lens is not to be learned from: its mean cover, and all that pictures do not show."""
    return np.maximum(mean, covered(mean))


def with_clear_pixels(enhanced: Image, photograph: Image, cover: Plane) -> Image:
    """An enhanced picture with the photograph's detail where nothing covers the lens.

    Args:
        enhanced: [H, W, 3], sRGB-encoded, [0, 1].
        photograph: the same without its mist, and nothing else done to it.
        cover: mean cover by drops [H, W].

    Returns:
        [H, W, 3], [0, 1].
    """
    hidden = covered(cover)[..., None]
    clear, change = 1 - hidden, enhanced - photograph
    deviation = SMOOTH * max(cover.shape)
    share = cv2.GaussianBlur(clear, (0, 0), deviation)[..., None]
    smooth = cv2.GaussianBlur(clear * change, (0, 0), deviation) / np.maximum(share, np.float32(MIN_SHARE))
    return np.asarray(np.clip(photograph + hidden * change + clear * smooth, 0, 1), np.float32)
