"""Photographs with rain drawn on them whenever a pair is asked for."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from hydroviews.pairs.captures import SOURCES, Capture
from hydroviews.pairs.drawing import KINDS, Pair, draw_rain, families_of
from hydroviews.pairs.exposure import draw_exposure, exposed
from hydroviews.pairs.lens_pool import Pool
from hydroviews.pairs.mist_alone import draw_mist_alone
from hydroviews.pairs.photographs import Bytes, Frame
from hydroviews.pairs.raindrops import OWN_MIST

OWN, RECIPES = {"window", "raindrop"}, {"pane"}  # families of rain with the data set's mist, and with other


class DrawnRain:
    """A source of pairs without end; all chance comes from the generators that are handed in."""

    def __init__(
        self,
        photographs: Sequence[dict[int, Bytes]],
        pool: Pool,
        kinds: Mapping[str, float] = KINDS,
        companions: Sequence[int] = (0,),
    ) -> None:
        """Of photographs.

        Args:
            photographs: from `read_photographs`.
            pool: wet lenses for their frames, of all kinds drawn.
            kinds: shares of the kinds of rain, which add up to 1: see `drawing.shares_without`.
            companions: how many other pictures of a capture come with one, any of these numbers.
        """
        self._photographs, self._pool, self._kinds, self._companions = photographs, pool, kinds, companions

    def companions(self, rng: np.random.Generator) -> int:
        """How many other pictures come with one."""
        return int(rng.choice(self._companions))

    def pair(self, rng: np.random.Generator) -> Pair:
        """A whole picture in rain, and clean, with others of an imitated capture."""
        sides = self._photographs[rng.integers(len(self._photographs))]
        capture = self._capture(sides, rng)
        photograph = sides[int(rng.choice(list(sides)))]
        photograph = exposed(photograph[:, ::-1] if capture.mirrored else photograph, capture.exposure)
        height, width = photograph.shape[:2]
        kind = str(rng.choice(list(self._kinds), p=list(self._kinds.values())))
        frame: Frame = (width, height)
        companions = capture.pictures(self.companions(rng), frame, (width // 2, height // 2), rng)
        return draw_rain(photograph, kind, self._pool[frame], rng, companions)

    def misted(
        self, rng: np.random.Generator, side: int, count: int
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
        """So many pictures of a capture, squeezed to [side, side] pixels, in mist alone: see `draw_mist_alone`.

        Mist of a family that is left out of the kinds of rain is left out here, too.
        """
        sides = self._photographs[rng.integers(len(self._photographs))]
        height, width = next(iter(sides.values())).shape[:2]
        pictures = self._capture(sides, rng).pictures(count, (width, height), (side, side), rng)
        own, recipes = (bool(some & families_of(self._kinds)) for some in (OWN, RECIPES))
        return draw_mist_alone(pictures, rng, OWN_MIST if own == recipes else float(own))

    def _capture(self, sides: dict[int, Bytes], rng: np.random.Generator) -> Capture:
        """Of this photograph, and of others for the most part."""
        others = rng.integers(len(self._photographs), size=int(rng.choice(SOURCES)) - 1)
        sources = [sides, *(self._photographs[other] for other in others)]
        largest = [source[max(source)] for source in sources]
        return Capture(largest, bool(rng.uniform() < 0.5), draw_exposure(rng))
