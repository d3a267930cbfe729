"""How much the training views depend on where each Gaussian is, and removal of those on which they do not.

Utilisation-based pruning (Sabour et al. 2025, SpotLessSplats, section 4.2.3):

    u_g = sum over views of |mean over pixels and channels of |dC / d(x_g, y_g)||^2

for positions on the image in units of half of it. Unlike in their code, gradients are added up as absolute values, so
that those of channels and at a Gaussian's two sides do not cancel, over all training views and with all pixels, masked
ones too.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from baselines.splatting.gaussians import Gaussians
from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.kernels.rasterizer import backward, render
from baselines.splatting.strategies.pruning import MeasuresUse, Pruning
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import Image


@dataclass(frozen=True)
class UtilisationPruning(Pruning):
    """Removal of the Gaussians on whose positions the training views depend least."""

    measure: str = "utilisation"  # so that runs tell it from removal by contribution

    def use(self, backend: MeasuresUse, cameras: Sequence[Camera]) -> NDArray[np.float64]:
        """See Pruning: u [N]."""
        return backend.utilisation(cameras)


def channel_shares(image: Image) -> Iterator[Image]:
    """For each channel the gradient [H, W, 3] of the image's mean by it: together they would cancel within a pixel."""
    for channel in range(3):
        share = np.zeros_like(image)
        share[..., channel] = 1 / image.size
        yield share


def utilisation(
    gaussians: Gaussians,
    cameras: Iterable[Camera],
    near: float,
    antialiased: bool = False,
    buffers: BufferPool | None = None,
) -> NDArray[np.float64]:
    """u [N] of all Gaussians, >= 0."""
    buffers, bare = buffers or BufferPool(), gaussians.bare()
    total = np.zeros(len(gaussians))
    for camera in cameras:
        image, state = render(bare, camera, near=near, antialiased=antialiased, buffers=buffers)
        half_size = np.array([camera.width / 2, camera.height / 2])
        moved = np.zeros((len(gaussians), 2))
        for share in channel_shares(image):
            moved += backward(state, share).means2d_absolute
        total += np.square(moved * half_size).sum(axis=1)
    return total
