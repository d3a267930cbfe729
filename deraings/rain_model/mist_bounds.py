"""What photographs alone say of mist on the lens: the light that it should have, and how thick it can be at most."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from deraings.rain_model.mist_config import VeilConfig
from deraings.rain_model.moments import moment_weights, moments_of
from hydroviews.rain.light import air_light
from hydroviews.scene.images import to_linear

SEEN = 40  # pictures of a moment that are looked at
DARK = 1e-3  # mist is taken to be at least as light


@dataclass(frozen=True)
class MistBounds:
    """What mist can be: V on a grid of knots [T, h, w], a few moments of the film and the picture."""

    n_views: int
    colour: NDArray[np.float32]  # a [3], linear light
    thickest: NDArray[np.float32]  # the most that V can be
    possible: NDArray[np.float32]  # the same, less its smallest value
    suspected: bool  # whether it is enough to look for mist

    def at(self, view: int, places: NDArray[np.float32]) -> NDArray[np.float32]:
        """Possible V [N] of a view at places [N, 2], across and down, [0, 1]."""
        knots = np.tensordot(moment_weights(view, self.n_views, len(self.possible)), self.possible, 1)
        across, down = places.T
        where = (down * (knots.shape[0] - 1), across * (knots.shape[1] - 1))
        return np.asarray(map_coordinates(knots, where, order=1, mode="nearest"))


def mist_bounds(
    pictures: Sequence[NDArray[np.uint8]], config: VeilConfig, hidden: Sequence[NDArray[np.bool_] | None] = ()
) -> MistBounds:
    """What photographs [H, W, 3], in order of name, allow of mist; pixels of the masks `hidden` are not looked at."""
    height, width = pictures[0].shape[:2]
    cell = max(height, width) / config.cells
    moments = moments_of(len(pictures), config.views_a_moment, config.most_moments)
    grid = (moments, max(2, round(height / cell) + 1), max(2, round(width / cell) + 1))
    colour = mist_light(pictures, config.brightest, config.tint)
    bound = thickest_veil(pictures, colour, grid, config.darkest, hidden)
    possible = bound - bound.min()
    even = config.evenness * np.median(possible)
    suspected = bool(np.quantile(possible, 0.25) >= config.thinnest)
    return MistBounds(len(pictures), colour, np.minimum(bound, even), np.minimum(possible, even), suspected)


def mist_light(pictures: Sequence[NDArray[np.uint8]], brightest: float, tint: float) -> NDArray[np.float32]:
    """The linear light [3] that mist should have: that of the brightest pixels of all pictures [H, W, 3], paler.

    Mist is lit from all around, so it is as bright as the sky or what else is bright, and nearly grey.
    """
    samples = [picture[::8, ::8].reshape(-1, 3) for picture in pictures]
    light = to_linear(np.concatenate(samples).astype(np.float32) / np.float32(255))
    return air_light(light, brightest, tint)


def thickest_veil(
    pictures: Sequence[NDArray[np.uint8]],
    colour: NDArray[np.float32],
    grid: tuple[int, int, int],
    darkest: float,
    hidden: Sequence[NDArray[np.bool_] | None] = (),
) -> NDArray[np.float32]:
    """The thickest V that any knot [T, h, w] may have: V a is nowhere lighter than the dark things seen through it.

    Args:
        pictures: [H, W, 3] each; up to SEEN a moment are looked at.
        colour: a [3], linear light.
        grid: T, h and w.
        darkest: quantile of all pixels of a cell in all pictures that counts as dark.
        hidden: masks [H, W] of pixels that are not looked at.

    Returns:
        The largest V of the cells around each knot; 1 where nothing was seen.
    """
    moments, height, width = grid
    masks = tuple(hidden) or (None,) * len(pictures)
    table = to_linear(np.arange(256, dtype=np.float32) / 255)
    bound = np.empty(grid, np.float32)
    for moment in range(moments):
        near = [i for i in range(len(pictures)) if moment_weights(i, len(pictures), moments)[moment] >= 0.5]
        shares = []
        for index in near[:: -(-len(near) // SEEN)]:
            share, mask = (table[pictures[index]] / np.maximum(colour, DARK)).min(axis=2), masks[index]
            shares.append(share if mask is None else np.where(mask, np.float32(np.nan), share))
        cells = np.pad(_cell_quantiles(shares, (height - 1, width - 1), darkest), 1)
        around = [cells[i : i + height, j : j + width] for i in (0, 1) for j in (0, 1)]
        bound[moment] = np.maximum.reduce(around)
    return bound


def _cell_quantiles(planes: list[NDArray[np.float32]], cells: tuple[int, int], share: float) -> NDArray[np.float32]:
    """A quantile of all values of several planes, of any sizes, in each of h x w cells; 1 where all values are NaN."""
    quantiles = np.ones(cells, np.float32)
    rows = [np.array_split(plane, cells[0], axis=0) for plane in planes]
    for i in range(cells[0]):
        across = [np.array_split(row[i], cells[1], axis=1) for row in rows]
        for j in range(cells[1]):
            values = np.concatenate([cell[j].ravel() for cell in across])
            values = values[np.isfinite(values)]
            if values.size:
                quantiles[i, j] = np.quantile(values, share)
    return quantiles
