"""Peak signal-to-noise ratio."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hydroviews.metrics.inputs import Mask, Pictures, Score, score_pairs

if TYPE_CHECKING:
    from torch import Tensor


def psnr(image: Pictures, target: Pictures, ignored: Mask | None = None) -> Score:
    """PSNR in dB over all shown pixels and channels of each image; infinite for equal images.

    Args:
        image: [H, W, 3] or [N, 3, H, W], values in [0, 1].
        target: the same shape.
        ignored: bool [H, W] or [N, H, W], true where pixels are hidden.

    Raises:
        ValueError: see `score_pairs`.
    """
    return score_pairs(_psnr, image, target, ignored)


def _psnr(image: Tensor, target: Tensor, shown: Tensor) -> Tensor:
    squares = (image.double() - target.double()).square().mean(dim=(1, 2, 3))  # zero where hidden
    mean_squared_error = squares / shown.double().mean(dim=(1, 2))
    return -10 * mean_squared_error.log10()
