"""The pixels of a step: a regular grid in one photograph, or in a few, of random size and place (Ha-NeRF)."""

from math import isqrt

import numpy as np
import torch
from numpy.typing import NDArray

from baselines.volumetric.rays.batches import Batch, Draw, TrainingPixels
from baselines.volumetric.rays.spaces import Space
from hydroviews.scene.seeds import generator

SMALLEST_SCALE = 0.5  # smallest side of a grid, as a share of the photograph's side (Ha-NeRF's and CR-NeRF's authors)


def side_of_grids(rays: int, photographs: int) -> int:
    """Rays on a side of a photograph's grid, where a step has so many rays in so many photographs.

    Raises:
        ValueError: they make no square in each.
    """
    side = isqrt(rays // max(1, photographs))
    if photographs < 1 or side**2 * photographs != rays:
        raise ValueError(f"{rays} rays a step in {photographs} photographs: expected a square of rays in each")
    return side


def grids(photographs: int, side: int) -> Draw:
    """How a step's pixels are drawn: `photographs` views, all of them in turn, and `side` x `side` pixels of each."""

    def draw(pixels: TrainingPixels, seed: int, iteration: int, rays: int, space: Space, device: torch.device) -> Batch:
        visited = views_in_turn(seed, iteration, photographs, len(pixels.images))
        random = generator(seed, "grid", iteration)
        parts = []
        for view in visited:
            height, width = pixels.images.pixels(int(view)).shape[:2]
            parts.append(grid(height, width, side, SMALLEST_SCALE, random))
        rows, columns = np.concatenate(parts, axis=1)
        return pixels.at(np.repeat(visited, side**2), rows, columns, space, device)

    return draw


def views_in_turn(seed: int, iteration: int, photographs: int, views: int) -> NDArray[np.int64]:
    """The views of a step: each once a round, in an order of the round's own."""
    visited = []
    for number in range(iteration * photographs, (iteration + 1) * photographs):
        turn, place = divmod(number, views)
        visited.append(generator(seed, "turn", turn).permutation(views)[place])
    return np.array(visited, np.int64)


def grid(height: int, width: int, side: int, min_scale: float, random: np.random.Generator) -> NDArray[np.int64]:
    """Rows and columns [2, side side] of a grid, row by row.

    It spans a share s in [min_scale, 1) of the photograph's sides. The first of its lines may lie anywhere from where
    the photograph begins to where the last one still is in it: so every pixel is reached.
    """
    steps = np.arange(side) / side * random.uniform(min_scale, 1)
    offsets = random.uniform(0, 1 - steps[-1], 2)
    rows = np.minimum((steps + offsets[0]) * height, height - 1).astype(np.int64)
    columns = np.minimum((steps + offsets[1]) * width, width - 1).astype(np.int64)
    return np.stack(np.meshgrid(rows, columns, indexing="ij")).reshape(2, -1)
