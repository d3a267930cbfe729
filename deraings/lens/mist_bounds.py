"""Bounds on mist from photographs alone: the light it should have, and the most that mist_alpha can be.

Drops with light of their own lie in front of the mist. They may be darker or lighter than the mist, so pixels under
them (`still_pixels`) do not count.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from deraings.lens.still_pixels import still_cover
from deraings.lens.time_knots import count_time_knots, time_weights, views_near
from hydroviews.scene.images import luminance, to_linear

CELLS = 24  # grid cells along the longer side
BRIGHTEST = 0.05  # share of all pixels that mist is expected to be as light as; 0.05 to 0.3 make no difference
DARK = 0.05  # share of what a place of the lens shows that may be darker than the mist there: noise
MAX_PICTURES = 40  # that are looked at for a time knot
WET = 0.25  # share of a pixel under drops with light of their own, from which it says nothing of mist
BESIDE = 5  # pixels, of the square around a place that drops may not touch: point colours are a little blurred
MIN_LIGHT = 1e-3  # linear; mist is taken to be at least as light


@dataclass(frozen=True)
class MistBounds:
    """What mist can be; mist_alpha on a grid of knots [T, h, w], a few times and places in the picture."""

    n_views: int
    colour: NDArray[np.float32]  # a [3], linear light
    max_alpha: NDArray[np.float32]  # the most that mist_alpha can be
    possible: NDArray[np.float32]  # the same, less its smallest value
    masks: list[NDArray[np.bool_] | None]  # [H, W] a picture: masked pixels, and those under drops

    def at(self, view: int, places: NDArray[np.float32]) -> NDArray[np.float32]:
        """Possible mist_alpha [N] of a view at places [N, 2], across and down, [0, 1]."""
        knots = np.tensordot(time_weights(view, self.n_views, len(self.possible)), self.possible, 1)
        across, down = places.T
        where = (down * (knots.shape[0] - 1), across * (knots.shape[1] - 1))
        return np.asarray(map_coordinates(knots, where, order=1, mode="nearest"))

    def dry_at(self, view: int, places: NDArray[np.float32]) -> NDArray[np.bool_]:
        """True [N] if neither a mask nor a drop of a view touches places [N, 2], across and down, [0, 1]."""
        mask = self.masks[view]
        if mask is None:
            return np.ones(len(places), np.bool_)
        wet = cv2.dilate(mask.astype(np.uint8), np.ones((BESIDE, BESIDE), np.uint8)) > 0
        size = np.array(wet.shape[::-1])
        across, down = np.clip((places * size).astype(int), 0, size - 1).T
        return np.asarray(~wet[down, across], np.bool_)


def mist_bounds(pictures: Sequence[NDArray[np.uint8]], hidden: Sequence[NDArray[np.bool_] | None] = ()) -> MistBounds:
    """What photographs [H, W, 3], in order of name, allow of mist; pixels of the masks `hidden` are not looked at."""
    height, width = pictures[0].shape[:2]
    cell = max(height, width) / CELLS
    times = count_time_knots(len(pictures))
    grid = (times, max(2, round(height / cell) + 1), max(2, round(width / cell) + 1))
    masks = dry_masks(pictures, hidden, times)
    colour = mist_light(pictures, masks)
    bound = max_mist_alpha(pictures, colour, grid, masks)
    known = bound[np.isfinite(bound)]
    least = known.min() if known.size else np.float32(1)
    bound = np.where(np.isfinite(bound), bound, np.float32(1))
    return MistBounds(len(pictures), colour, bound, bound - least, masks)


def mist_light(
    pictures: Sequence[NDArray[np.uint8]], hidden: Sequence[NDArray[np.bool_] | None] = ()
) -> NDArray[np.float32]:
    """The linear light [3] that mist should have: grey, as light as the brightest pixels of all pictures [H, W, 3].

    Mist is lit from all around, so it is as bright as the sky or what else is bright. Its colour is learned.
    """
    masks = tuple(hidden) or (None,) * len(pictures)
    shown = (slice(None) if mask is None else ~mask[::8, ::8] for mask in masks)
    samples = [picture[::8, ::8][part].reshape(-1, 3) for picture, part in zip(pictures, shown, strict=True)]
    light = luminance(to_linear(np.concatenate(samples).astype(np.float32) / np.float32(255)))
    if not light.size:
        return np.ones(3, np.float32)
    bright = light[light >= np.quantile(light, 1 - BRIGHTEST)].mean()
    return np.full(3, bright, np.float32)


def max_mist_alpha(
    pictures: Sequence[NDArray[np.uint8]],
    colour: NDArray[np.float32],
    grid: tuple[int, int, int],
    hidden: Sequence[NDArray[np.bool_] | None] = (),
) -> NDArray[np.float32]:
    """The most that mist_alpha may be at any knot [T, h, w]: mist is nowhere lighter than the dark things behind it.

    Args:
        pictures: [H, W, 3] each; up to MAX_PICTURES a time are looked at.
        colour: a [3], linear light.
        grid: T, h and w.
        hidden: masks [H, W] of pixels that are not looked at.

    Returns:
        The largest bound of the cells around each knot; NaN where nothing was seen.
    """
    times, height, width = grid
    masks = tuple(hidden) or (None,) * len(pictures)
    table = to_linear(np.arange(256, dtype=np.float32) / 255)
    bound = np.empty(grid, np.float32)
    for time in range(times):
        near = views_near(time, len(pictures), times)
        planes = []
        for index in near[:: -(-len(near) // MAX_PICTURES)]:
            alpha, mask = (table[pictures[index]] / np.maximum(colour, MIN_LIGHT)).min(axis=2), masks[index]
            planes.append(alpha if mask is None else np.where(mask, np.float32(np.nan), alpha))
        cells = _cell_quantiles(planes, (height - 1, width - 1), DARK)
        cells = np.pad(cells, 1, constant_values=np.nan)
        around = [cells[i : i + height, j : j + width] for i in (0, 1) for j in (0, 1)]
        bound[time] = np.fmax.reduce(around)
    return bound


def dry_masks(
    pictures: Sequence[NDArray[np.uint8]], hidden: Sequence[NDArray[np.bool_] | None], times: int
) -> list[NDArray[np.bool_] | None]:
    """The masks [H, W] `hidden`, one a picture, and the pixels that drops with light of their own cover at its time."""
    masks = list(hidden) or [None] * len(pictures)
    dry = list(masks)
    for time in range(times):
        near = views_near(time, len(pictures), times)
        for size in sorted({pictures[i].shape for i in near}):
            views = [i for i in near if pictures[i].shape == size]
            wet = still_cover([pictures[i] for i in views], [masks[i] for i in views]) > WET
            for i in views:
                mask = masks[i]
                dry[i] = wet if mask is None else wet | mask
    return dry


def _cell_quantiles(planes: list[NDArray[np.float32]], cells: tuple[int, int], share: float) -> NDArray[np.float32]:
    """A quantile of all values of several planes, of any sizes, in each of h x w cells; NaN where all values are."""
    quantiles = np.full(cells, np.nan, np.float32)
    rows = [np.array_split(plane, cells[0], axis=0) for plane in planes]
    for i in range(cells[0]):
        across = [np.array_split(row[i], cells[1], axis=1) for row in rows]
        for j in range(cells[1]):
            values = np.concatenate([cell[j].ravel() for cell in across])
            values = values[np.isfinite(values)]
            if values.size:
                quantiles[i, j] = np.quantile(values, share)
    return quantiles
