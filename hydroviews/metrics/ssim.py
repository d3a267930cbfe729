"""Structural similarity (Wang et al. 2004): 11x11 Gaussian window, sigma 1.5, valid positions only."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hydroviews.metrics.inputs import Mask, Pictures, Score, score_pairs

if TYPE_CHECKING:
    from torch import Tensor

WINDOW, SIGMA = 11, 1.5
C1, C2 = 0.01**2, 0.03**2  # stabilisers for a data range of 1


def ssim(image: Pictures, target: Pictures, ignored: Mask | None = None) -> Score:
    """Mean SSIM of each image over channels and all window positions that lie inside the image.

    Windows in which a pixel is hidden are left out.

    Args:
        image: [H, W, 3] or [N, 3, H, W], values in [0, 1], at least 11x11 pixels.
        target: the same shape.
        ignored: bool [H, W] or [N, H, W], true where pixels are hidden.

    Raises:
        ValueError: see `score_pairs`; an image smaller than the window; or no window without hidden pixels.
    """
    return score_pairs(_ssim, image, target, ignored)


def _ssim(image: Tensor, target: Tensor, shown: Tensor) -> Tensor:
    import torch
    from torch.nn.functional import max_pool2d

    similarity = ssim_map(image.double(), target.double()).mean(dim=1)
    whole = max_pool2d((~shown)[:, None].float(), WINDOW, stride=1)[:, 0] == 0
    counts = whole.sum(dim=(1, 2))
    if not counts.all():
        raise ValueError(f"every window of {WINDOW}x{WINDOW} pixels has a hidden one")
    return torch.where(whole, similarity, 0).sum(dim=(1, 2)) / counts


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
    import torch
    from torch.nn.functional import conv2d

    offsets = torch.arange(WINDOW, dtype=x.dtype, device=x.device) - WINDOW // 2
    taps = torch.exp(-(offsets**2) / (2 * SIGMA**2))
    taps = taps / taps.sum()
    planes = x.flatten(0, 1)[:, None]
    planes = conv2d(conv2d(planes, taps.view(1, 1, 1, -1)), taps.view(1, 1, -1, 1))
    return planes.view(*x.shape[:2], *planes.shape[-2:])
