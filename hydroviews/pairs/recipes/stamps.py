"""Drops on a grid of pixels: which drop covers a pixel, and where in the drop it lies."""

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from hydroviews.pairs.recipes.fields import Plane
from hydroviews.pairs.recipes.shapes import Shapes

PROBES = 8  # places on a rim that have to be free


class Stamped(NamedTuple):
    """Drops in focus, none over another, smoothed at their rims."""

    cover: Plane  # [H, W], [0, 1]
    place: NDArray[np.float32]  # [H, W, 2], right and down from the drop's middle; as long as 1 at its rim
    owner: NDArray[np.int32]  # [H, W], index of the drop; -1 where there is none


def stamp(shapes: Shapes, width: int, height: int) -> Stamped:
    """All drops that are free when their turn comes, in order, in [height, width] pixels."""
    cover = np.zeros((height, width), np.float32)
    place, owner = np.zeros((height, width, 2), np.float32), np.full((height, width), -1, np.int32)
    _stamp(shapes.middles, shapes.radii, shapes.aspects, shapes.turns, shapes.waves, cover, place, owner)
    return Stamped(cover, place, owner)


@numba.njit(cache=True, nogil=True)
def _stamp(middles, radii, aspects, turns, waves, cover, place, owner):  # type: ignore[no-untyped-def]
    height, width = cover.shape
    for i in range(len(radii)):
        x0, y0 = middles[i]
        wide, high = radii[i] * np.sqrt(aspects[i]), radii[i] / np.sqrt(aspects[i])
        cos, sin = np.cos(turns[i]), np.sin(turns[i])
        if not _is_free(x0, y0, wide, high, cos, sin, owner):
            continue
        reach = 1.5 * max(wide, high) + 1
        most = min(1.0, np.pi * wide * high)  # of a pixel that a smaller drop covers
        for y in range(max(0, int(y0 - reach)), min(height, int(y0 + reach) + 2)):
            for x in range(max(0, int(x0 - reach)), min(width, int(x0 + reach) + 2)):
                dx, dy = x + 0.5 - x0, y + 0.5 - y0
                a, b = (cos * dx + sin * dy) / wide, (cos * dy - sin * dx) / high
                r = max(np.sqrt(a * a + b * b), 1e-6)
                far = np.sqrt(dx * dx + dy * dy)
                c, s = a / r, b / r
                c2, s2 = c * c - s * s, 2 * c * s
                rim = 1 + waves[i, 0] * c2 + waves[i, 1] * s2
                rim += waves[i, 2] * (c2 * c - s2 * s) + waves[i, 3] * (s2 * c + c2 * s)
                beyond = (rim / r - 1) * far if far > 0.1 else min(wide, high)
                share = most * min(max(beyond + 0.5, 0.0), 1.0)
                if share > cover[y, x]:
                    cover[y, x], owner[y, x] = share, i
                    scale = r / rim / max(far, 1e-6)
                    place[y, x, 0], place[y, x, 1] = scale * dx, scale * dy


@numba.njit(cache=True, nogil=True)
def _is_free(x0, y0, wide, high, cos, sin, owner):  # type: ignore[no-untyped-def]
    """True if neither the middle nor PROBES places on the rim belong to a drop."""
    height, width = owner.shape
    for k in range(PROBES + 1):
        turn = 2 * np.pi * k / PROBES
        far = 0.0 if k == PROBES else 1.1
        a, b = far * wide * np.cos(turn), far * high * np.sin(turn)
        x, y = int(np.floor(x0 + cos * a - sin * b)), int(np.floor(y0 + sin * a + cos * b))
        if 0 <= x < width and 0 <= y < height and owner[y, x] >= 0:
            return False
    return True
