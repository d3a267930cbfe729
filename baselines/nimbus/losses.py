"""What keeps a medium smooth, and haze out of the scene (NimbusGS)."""

import torch
from torch import Tensor
from torch.nn import functional

PATCH = 1 / 40  # side of the dark channel's patches, in longer sides of the picture: 15 pixels of 600


def total_variation(grid: Tensor) -> Tensor:
    """Mean absolute difference of neighbours along the axes of a grid [n, n, n], the three of them added up."""
    return sum((grid.diff(dim=axis).abs().mean() for axis in range(3)), start=grid.new_zeros(()))


def dark_channel(image: Tensor, side: int) -> Tensor:
    """The least value of any channel in patches of a picture [H, W, 3], [h, w] (He et al. 2009).

    Patches are squares that begin at every half of their side.

    Args:
        image: the picture.
        side: of a patch in pixels, at least 1; none is larger than the picture.
    """
    height, width = image.shape[:2]
    side = max(1, min(side, height, width))
    least = image.amin(dim=2)
    return -functional.max_pool2d(-least[None, None], side, stride=max(1, side // 2))[0, 0]


def dark_loss(image: Tensor, patch: float = PATCH) -> Tensor:
    """Mean dark channel of a picture [H, W, 3], for patches of a share of its longer side."""
    return dark_channel(image, round(patch * max(image.shape[:2]))).mean()


def finite_or_zero(image: Tensor) -> Tensor:
    """A picture with 0 in place of what is not finite."""
    return torch.nan_to_num(image, 0, 0, 0)
