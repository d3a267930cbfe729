"""Small photographs in mist alone, for the network's branch that looks at whole pictures."""

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from hydroviews.pairs.exposure import LINEAR, air_light
from hydroviews.pairs.raindrops import OWN_MIST
from hydroviews.pairs.recipes.mist import draw_level
from hydroviews.pairs.recipes.panes import Pane, draw_mist
from hydroviews.rain.lens.patterns import pattern as drops_pattern
from hydroviews.rain.lens.patterns.mist import mist_veil

MIST_SIZES = ((80, 53), (53, 80))  # pixels, in which mist for pictures of mist alone is drawn


def draw_mist_alone(
    photographs: NDArray[np.uint8], rng: np.random.Generator, own: float = OWN_MIST
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """Photographs [K, S, S, 3] of a capture in the same mist alone, or in none.

    Args:
        photographs: sRGB-encoded.
        rng: the generator.
        own: share of the data set's own mist; the rest is the recipes'.

    Returns:
        Rainy, clean, and the mist [S, S, 4] as in `drawing.Pair`.
    """
    side = photographs.shape[1]
    if rng.uniform() < own:
        pane = own_mist(LINEAR[photographs[0]], rng, side)
    else:
        pane = draw_mist(rng, side, side, draw_level(rng))
    clean = photographs.astype(np.float32) / 255
    return np.stack([pane.over(picture) for picture in clean]), clean, pane.mist()


def own_mist(linear: NDArray[np.float32], rng: np.random.Generator, side: int) -> Pane:
    """The data set's mist, drawn small for a photograph [S, S, 3] of linear light."""
    pattern = replace(drops_pattern.draw_pattern(rng), mist=draw_level(rng))
    pattern = pattern if rng.uniform() < OWN_MIST else replace(pattern, rivulets=0)
    shape = MIST_SIZES[int(rng.integers(len(MIST_SIZES)))]
    share = np.asarray(cv2.resize(mist_veil(pattern, *shape, float(rng.uniform())), (side, side)), np.float32)
    return Pane(share, air_light(linear) * np.array(pattern.air, np.float32))
