"""Peak signal-to-noise ratio."""

import torch
from torch import Tensor

from hydroviews.metrics.inputs import Pictures, Score, score_pairs


def psnr(image: Pictures, target: Pictures) -> Score:
    """PSNR in dB over all pixels and channels of each image; infinite for equal images.

    Args:
        image: [H, W, 3] or [N, 3, H, W], values in [0, 1].
        target: the same shape.

    Raises:
        ValueError: see `score_pairs`.
    """
    return score_pairs(_psnr, image, target)


def _psnr(image: Tensor, target: Tensor) -> Tensor:
    mean_squared_error = (image.double() - target.double()).square().mean(dim=(1, 2, 3))
    return -10 * torch.log10(mean_squared_error)
