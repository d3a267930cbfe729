"""The photometric loss in float64, every window of SSIM spelled out, and weights that are hard on it."""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import pad

RADIUS = 5
KINDS = ("scattered", "block", "border", "one pixel", "nothing", "fractional", "large", "small", "many sizes")


def loss_by_windows(image: Tensor, target: Tensor, share: float, weights: Tensor | None = None) -> Tensor:
    """The mean of w ((1 - share) |x - y| + share (1 - SSIM)) of images [H, W, 3] in [0, 1], weights w [H, W] from 0 on.

    An image may be anything at weight 0. The outside is 0, and weighs as the inside of the window on average.
    """
    height, width, _ = image.shape
    w = torch.ones(height, width) if weights is None else weights
    x, y = (torch.where(w[..., None] > 0, picture.double(), 0) for picture in (image, target))
    along = torch.exp(-(torch.arange(-RADIUS, RADIUS + 1, dtype=torch.float64) ** 2) / (2 * 1.5**2))
    window = torch.outer(along, along)[..., None] / along.sum() ** 2
    x_outside, y_outside, w_outside = (pad(plane, (0, 0, *[RADIUS] * 4)) for plane in (x, y, w.double()[..., None]))
    inside = pad(torch.ones(height, width, 1), (0, 0, *[RADIUS] * 4)) > 0
    total = 0 * x.sum()  # differentiable where all weights are 0, too
    for row in range(height):
        for column in range(width):
            if not w[row, column] > 0:
                continue
            here = slice(row, row + 2 * RADIUS + 1), slice(column, column + 2 * RADIUS + 1)
            average = (window * w_outside[here]).sum() / (window * inside[here]).sum()
            shares = window * torch.where(inside[here], w_outside[here], average)
            shares = shares / shares.sum()
            similarity = _ssim(x_outside[here], y_outside[here], shares)
            difference = (x[row, column] - y[row, column]).abs()
            total = total + w[row, column] * ((1 - share) * difference + share * (1 - similarity)).sum()
    return total / x.numel()


def _ssim(x: Tensor, y: Tensor, shares: Tensor) -> Tensor:
    """SSIM [3] of two windows [11, 11, 3] in which pixels have shares [11, 11, 1] that add up to 1."""
    mean_x, mean_y = (shares * x).sum((0, 1)), (shares * y).sum((0, 1))
    variance_x, variance_y = ((shares * (z - m) ** 2).sum((0, 1)) for z, m in ((x, mean_x), (y, mean_y)))
    covariance = (shares * (x - mean_x) * (y - mean_y)).sum((0, 1))
    c1, c2 = 0.01**2, 0.03**2
    likeness = (2 * mean_x * mean_y + c1) * (2 * covariance + c2)
    return likeness / ((mean_x**2 + mean_y**2 + c1) * (variance_x + variance_y + c2))


def hard_weights(kind: str, height: int, width: int) -> NDArray[np.float32]:
    """Weights [H, W] of one of KINDS."""
    generator = np.random.default_rng(0)
    weights = np.ones((height, width))
    if kind == "scattered":  # as behind many small drops
        weights[generator.random(weights.shape) < 0.26] = 0
    elif kind == "block":  # wider than a window
        weights[height // 8 : -(height // 8) or None, : width // 2] = 0
    elif kind == "border":
        weights[[0, -1]] = weights[:, :2] = weights[:, -2:] = 0
    elif kind == "one pixel":
        weights[:] = 0
        weights[height // 3, width // 3] = 1
    elif kind == "nothing":
        weights[:] = 0
    elif kind == "many sizes":
        weights = 10 ** generator.uniform(-20, 0, weights.shape)
    else:
        weights = generator.random(weights.shape) * {"fractional": 1, "large": 1e6, "small": 1e-6}[kind]
    return weights.astype(np.float32)
