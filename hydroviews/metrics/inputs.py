"""What every metric accepts, checked in one place."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Union

import numpy as np

if TYPE_CHECKING:
    from torch import Tensor

Pictures = Union[np.ndarray, "Tensor"]  # [H, W, 3] or [N, 3, H, W], values in [0, 1]
Score = Union[float, "Tensor"]  # of an image, or of each image of a batch [N]
Mask = Union[np.ndarray, "Tensor"]  # bool [H, W], or [N, H, W] for a batch; true where pixels are hidden

HIDDEN = 0.5  # what hidden pixels are set to in both images
TOLERANCE = 1e-4  # rounding of resampling filters; anything beyond is another value range


def score_pairs(
    metric: Callable[[Tensor, Tensor, Tensor], Tensor], image: Pictures, target: Pictures, ignored: Mask | None = None
) -> Score:
    """Apply `metric` (batches [N, 3, H, W] twice and what is shown, bool [N, H, W] -> [N]) to images or batches.

    Hidden pixels of both are set to 0.5 first.

    Raises:
        ValueError: shapes differ or are not [H, W, 3] or [N, 3, H, W], or values lie outside [0, 1]; the mask is of
            another size; or every pixel of an image is hidden.
    """
    import torch

    a, b = (torch.as_tensor(x if isinstance(x, torch.Tensor) else np.ascontiguousarray(x)) for x in (image, target))
    if a.shape != b.shape:
        raise ValueError(f"image and target differ in shape: {tuple(a.shape)} and {tuple(b.shape)}")
    single = a.ndim == 3
    if (single and a.shape[2] != 3) or (not single and (a.ndim != 4 or a.shape[1] != 3)):
        raise ValueError(f"expected an image [H, W, 3] or a batch [N, 3, H, W], got shape {tuple(a.shape)}")
    for name, x in (("image", a), ("target", b)):
        _check_values(name, x)
    if single:
        a, b = (x.permute(2, 0, 1)[None] for x in (a, b))
    shown = _shown(ignored, single, a)
    if ignored is not None:
        a, b = (torch.where(shown[:, None], x, HIDDEN) for x in (a, b))
    scores = metric(a, b, shown)
    return float(scores[0]) if single else scores


def _shown(ignored: Mask | None, single: bool, images: Tensor) -> Tensor:
    """What is not hidden, bool [N, H, W]."""
    import torch

    shape = (len(images), *images.shape[-2:])
    if ignored is None:
        return torch.ones(shape, dtype=torch.bool, device=images.device)
    mask = torch.as_tensor(ignored, device=images.device)
    mask = mask[None] if single else mask
    if mask.dtype != torch.bool or mask.shape != shape:
        raise ValueError(f"mask of {mask.dtype} and shape {tuple(mask.shape)}, expected bool {shape}")
    if mask.flatten(1).all(dim=1).any():
        raise ValueError("every pixel is hidden")
    return ~mask


def _check_values(name: str, x: Tensor) -> None:
    if not x.is_floating_point():
        raise ValueError(f"{name} has dtype {x.dtype}, expected floating point in [0, 1] (divide 8-bit values by 255)")
    if x.numel() == 0:
        raise ValueError(f"{name} is empty: shape {tuple(x.shape)}")
    low, high = float(x.detach().min()), float(x.detach().max())
    if not (low >= -TOLERANCE and high <= 1 + TOLERANCE):  # also catches NaN
        raise ValueError(f"{name} has values in [{low:g}, {high:g}], expected [0, 1]")
