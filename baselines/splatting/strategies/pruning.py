"""How much each Gaussian contributes to the training views, and removal of those that contribute least.

A pixel's colour is the sum over Gaussians of alpha T times their colour. So the derivative of the sum of all pixels by
a Gaussian's colour is its alpha T summed over pixels: how much of the image it is, in pixels.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from baselines.splatting.gaussians import Gaussians
from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.kernels.splats.sh_coefficients import C0
from baselines.splatting.rasterizer import backward, render
from baselines.splatting.state import TrainingState
from hydroviews.scene.cameras import Camera


@dataclass(frozen=True)
class Pruning:
    """Removal of the Gaussians that contribute least to the training views, by their blending weights alpha T."""

    at: tuple[float, ...] = (0.8,)  # shares of the iterations at which Gaussians are removed
    share: float = 0.0  # share of the Gaussians that is removed: those with the smallest sum of weights
    budget: int | None = None  # number of Gaussians at the end; every round removes an equal part of the surplus

    def due(self, iteration: int, iterations: int) -> bool:
        """Whether to prune after step `iteration`."""
        return iteration + 1 in self._rounds(iterations)

    def left(self, iteration: int, iterations: int) -> int:
        """How many rounds are left after step `iteration`, that one included."""
        return sum(after > iteration for after in self._rounds(iterations))

    def _rounds(self, iterations: int) -> set[int]:
        return {round(share * iterations) for share in self.at}


def contributions(
    gaussians: Gaussians,
    cameras: Iterable[Camera],
    near: float,
    antialiased: bool = False,
    buffers: BufferPool | None = None,
) -> NDArray[np.float64]:
    """Blending weights [N], summed over all pixels of all cameras, >= 0."""
    buffers = buffers or BufferPool()
    # grey, so that no colour is clamped at zero, where it would have no gradient
    grey = replace(gaussians.bare(), sh=np.zeros((len(gaussians), 1, 3), np.float32))
    total = np.zeros(len(gaussians))
    for camera in cameras:
        image, state = render(grey, camera, near=near, antialiased=antialiased, buffers=buffers)
        total += backward(state, np.ones_like(image)).parameters.sh[:, 0, 0]
    return total / C0


def prune(state: TrainingState, weights: NDArray[np.float64], pruning: Pruning, left: int = 1) -> TrainingState:
    """Without the Gaussians of the smallest weights; those that stay keep their moments and statistics.

    Args:
        state: trained so far.
        weights: from `contributions`, [N].
        pruning: the settings.
        left: rounds of pruning that are left, this one included.
    """
    keep = np.ones(len(weights), np.bool_)
    surplus = 0 if pruning.budget is None else max(0, len(weights) - pruning.budget)
    removed = max(int(pruning.share * len(weights)), -(-surplus // left))
    keep[np.argsort(weights, kind="stable")[:removed]] = False
    return state.keep(keep)
