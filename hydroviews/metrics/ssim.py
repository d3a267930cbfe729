"""Structural similarity (Wang et al. 2004): 11x11 Gaussian window, sigma 1.5, valid positions only."""

import torch
from torch import Tensor
from torch.nn.functional import conv2d

from hydroviews.metrics.inputs import Pictures, Score, score_pairs

WINDOW, SIGMA = 11, 1.5
C1, C2 = 0.01**2, 0.03**2  # stabilisers for a data range of 1


def ssim(image: Pictures, target: Pictures) -> Score:
    """Mean SSIM of each image over channels and all window positions that lie inside the image.

    Args:
        image: [H, W, 3] or [N, 3, H, W], values in [0, 1], at least 11x11 pixels.
        target: the same shape.

    Raises:
        ValueError: see `score_pairs`; or an image smaller than the window.
    """
    return score_pairs(lambda a, b: ssim_map(a.double(), b.double()).mean(dim=(1, 2, 3)), image, target)


def ssim_map(image: Tensor, target: Tensor) -> Tensor:
    """SSIM at every valid window position: [N, C, H, W] twice -> [N, C, H - 10, W - 10]."""
    if min(image.shape[-2:]) < WINDOW:
        raise ValueError(
            f"SSIM needs images of at least {WINDOW}x{WINDOW} pixels, got {image.shape[-1]}x{image.shape[-2]}"
        )
    mean_a, mean_b = _blur(image), _blur(target)
    variance_a = _blur(image * image) - mean_a * mean_a
    variance_b = _blur(target * target) - mean_b * mean_b
    covariance = _blur(image * target) - mean_a * mean_b
    luminance = (2 * mean_a * mean_b + C1) / (mean_a**2 + mean_b**2 + C1)
    structure = (2 * covariance + C2) / (variance_a + variance_b + C2)
    return luminance * structure


def _blur(x: Tensor) -> Tensor:
    """Separable Gaussian, valid positions: [N, C, H, W] -> [N, C, H - 10, W - 10]."""
    offsets = torch.arange(WINDOW, dtype=x.dtype, device=x.device) - WINDOW // 2
    taps = torch.exp(-(offsets**2) / (2 * SIGMA**2))
    taps = taps / taps.sum()
    planes = x.flatten(0, 1)[:, None]
    planes = conv2d(conv2d(planes, taps.view(1, 1, 1, -1)), taps.view(1, 1, -1, 1))
    return planes.view(*x.shape[:2], *planes.shape[-2:])
