"""Photographs with rain drawn on them whenever a pair is asked for."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from hydroviews.pairs.drawing import KINDS, LINEAR, Pair, Pool, draw_exposure, draw_mist_alone, draw_rain
from hydroviews.pairs.photographs import Bytes, Frame
from hydroviews.scene.images import Image, to_srgb


class DrawnRain:
    """A source of pairs without end; all chance comes from the generators that are handed in."""

    def __init__(self, photographs: Sequence[dict[int, Bytes]], pool: Pool, kinds: Mapping[str, float] = KINDS) -> None:
        """Of photographs.

        Args:
            photographs: from `read_photographs`.
            pool: wet lenses for their frames.
            kinds: shares of the kinds of rain, which add up to 1.
        """
        self._photographs, self._pool, self._kinds = photographs, pool, kinds

    def pair(self, rng: np.random.Generator) -> Pair:
        """A whole picture in rain, and clean."""
        photograph = exposed(self._photograph(rng), rng)
        height, width = photograph.shape[:2]
        kind = str(rng.choice(list(self._kinds), p=list(self._kinds.values())))
        frame: Frame = (width, height)
        return draw_rain(photograph, kind, self._pool[frame], rng)

    def misted(self, rng: np.random.Generator, side: int) -> tuple[Image, Image, NDArray[np.float32]]:
        """A whole picture squeezed to [side, side] pixels in mist alone, clean, and its mist: see `draw_mist_alone`."""
        return draw_mist_alone(self._photograph(rng), rng, side)

    def _photograph(self, rng: np.random.Generator) -> Bytes:
        """Any of them, mirrored or not."""
        sides = self._photographs[rng.integers(len(self._photographs))]
        photograph = sides[int(rng.choice(list(sides)))]
        return photograph[:, ::-1] if rng.uniform() < 0.5 else photograph


def exposed(photograph: Bytes, rng: np.random.Generator) -> Bytes:
    """The photograph [H, W, 3] as a shorter exposure in other light, so that dark scenes are learned too."""
    gains = draw_exposure(rng)
    table = np.stack([np.rint(255 * to_srgb(LINEAR * gain)) for gain in gains], axis=1).astype(np.uint8)
    return np.stack([table[photograph[..., channel], channel] for channel in range(3)], axis=-1)
