"""The companions of a photograph: others through the same lens, as long as the same drops are on it.

Drops that are new in every photograph leave the statistics of a dry lens. With these statistics, the network removes
none of them; alone, it removes them as far as single pictures allow.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import cv2
import numpy as np

from baselines.training.images import evenly_spread
from deraings.enhancement.architecture.lenses import Lens, Read, lenses_of_capture
from deraings.enhancement.clear_pixels import DROPS
from deraings.enhancement.enhance import predict
from deraings.enhancement.weights import Enhancer
from hydroviews.scene.images import Image
from hydroviews.scene.masks import Ignored

LOOKED_AT = 4  # photographs of a lens, evenly spread
# Mean cover by drops that the network predicts alone, from which a lens is wet. Dry photographs and streaks of eight
# scenes have 0.007 at most, fine dirt 0.015, medium drops and windows 0.05 and more.
WET = 0.03
# Share of this cover that the network predicts with companions, below which drops are new in every photograph. Medium
# drops and windows of eight scenes have 0.75 and more; new drops and snow have 0.05 at most, 0.3 of eight photographs.
STAYING = 0.5
BESIDE = 9  # pixels of the square around a hidden one in which nothing is told of rain


def lenses_of_companions(
    count: int, read: Read, enhancer: Enhancer, hidden: Callable[[int], Ignored | None] = lambda _: None
) -> list[Lens | None]:
    """`lenses_of_capture`, without statistics of drops where drops are new in every photograph.

    Args:
        count: how many photographs there are.
        read: the i-th one [H, W, 3], sRGB-encoded, 8 bits.
        enhancer: the network that is to enhance them.
        hidden: pixels [H, W] of the i-th one that are not to be looked at, None for none.
    """
    lenses = lenses_of_capture(count, read, enhancer.network, hidden)
    if not enhancer.network.config.cover:
        return lenses
    runs: dict[Lens, list[int]] = {}
    for index, lens in enumerate(lenses):
        if lens is not None:
            runs.setdefault(lens, []).append(index)
    for lens, run in runs.items():
        looked_at = [run[place] for place in evenly_spread(len(run), LOOKED_AT)]
        photographs = [(read(index).astype(np.float32) / np.float32(255), hidden(index)) for index in looked_at]
        if _drops_are_new(photographs, lens, enhancer):
            alone = replace(lens, fine=None)
            for index in run:
                lenses[index] = alone
    return lenses


def without_holes(cover: Image, hidden: Ignored | None) -> Image:
    """A cover by rain [H, W, 3], set to 0 where a mask [H, W] hides a pixel and beside it: holes look like drops."""
    if hidden is None:
        return cover
    beside = cv2.dilate(hidden.astype(np.uint8), np.ones((BESIDE, BESIDE), np.uint8)) > 0
    return np.where(beside[..., None], np.float32(0), cover)


def _drops_are_new(photographs: Sequence[tuple[Image, Ignored | None]], lens: Lens, enhancer: Enhancer) -> bool:
    """True if single photographs show drops that the statistics of their lens do not show."""

    def cover(lens: Lens | None) -> float:
        covers = [(predict(photograph, enhancer, lens=lens).cover, hidden) for photograph, hidden in photographs]
        return float(np.mean([without_holes(c, hidden)[..., DROPS].mean() for c, hidden in covers if c is not None]))

    alone = cover(None)
    return alone >= WET and cover(lens) < STAYING * alone
