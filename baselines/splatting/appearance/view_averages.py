"""Means of per-view values of Gaussians over the views that show them."""

from collections.abc import Callable, Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from tqdm import tqdm

from baselines.splatting.appearance.gaussians import in_sight, moved, tensors
from baselines.splatting.gaussians import Gaussians
from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.strategies.pruning import contributions
from hydroviews.scene.cameras import Camera

UNSEEN = 1e-6  # pixels that a Gaussian counts for where it is in sight but hidden
Values = Callable[[int, Camera, dict[str, Tensor]], Tensor]


@torch.no_grad()
def mean_over_views(
    gaussians: Gaussians,
    cameras: Sequence[Camera],
    values: Values,
    near: float,
    antialiased: bool,
    device: torch.device,
    what: str,
) -> NDArray[np.float32]:
    """Means [N, F] of values over views, each counting for as many pixels as the Gaussian is of it.

    A picture shows nothing of a Gaussian that is hidden in it. What is in sight nowhere has the mean of all.

    Args:
        gaussians: the scene.
        cameras: of the views.
        values: from a view's index, its camera relative to the Gaussians' origin and the parameters of those in sight
            there to their values [n, F].
        near: as trained.
        antialiased: as trained.
        device: of the parameters that `values` is given.
        what: is averaged, for the progress bar.
    """
    parameters = tensors(gaussians, device)
    buffers, sums, pixels = BufferPool(), np.zeros((len(gaussians), 0)), np.zeros(len(gaussians))
    for view, camera in enumerate(tqdm(cameras, desc=f"averaging the views' {what}", unit="view", leave=False)):
        local = moved(camera, gaussians.origin)
        rows, seen = in_sight(parameters, local)
        found, which = values(view, local, seen).cpu().numpy(), rows.cpu().numpy()
        shown = contributions(gaussians, [camera], near, antialiased, buffers)[which]
        weights = np.maximum(shown, UNSEEN)
        if not sums.shape[1]:
            sums = np.zeros((len(gaussians), found.shape[1]))
        sums[which] += weights[:, None] * found
        pixels[which] += weights
    overall = sums.sum(axis=0) / max(float(pixels.sum()), UNSEEN)
    means = np.where(pixels[:, None] > 0, sums / np.maximum(pixels, UNSEEN)[:, None], overall)
    return np.ascontiguousarray(means, np.float32)
