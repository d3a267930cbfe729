"""Weights by a visibility mask m that an image encoder predicts, learned from the loss that m weighs (GS-W, Wild-GS).

    L = mean(m l) + price mean((1 - m)^2),      l = (1 - lambda) |C^ - C| + lambda (1 - SSIM) of every pixel

Free to choose, m would end at 1 - l / (2 price), not below 0. The authors' code multiplies both pictures by m before it
compares them; weighing each pixel's loss differs at the edges of SSIM's windows alone.
"""

from collections.abc import Callable

import torch
from numpy.typing import NDArray
from torch import Tensor

from baselines.encoders.appearance import EncodedAppearance
from baselines.encoders.unet import at_size
from baselines.masking.pixel_weights import Comparison, PixelWeights
from baselines.splatting.kernels.photometric import Plane
from baselines.training.images import Size
from hydroviews.scene.images import Image


class VisibilityMask(PixelWeights):
    """m of the view that an appearance has encoded last; what is learned is part of the appearance."""

    def __init__(self, appearance: EncodedAppearance) -> None:
        self.appearance = appearance
        self.first = round(appearance.config.visible_from * appearance.iterations)

    def weigh(self, seen: Comparison) -> Plane | None:
        """See PixelWeights; gradients by the mask are left where `EncodedAppearance.learn` finds them."""
        if seen.iteration < self.first:
            return None
        return learn_visibility(self.appearance.visible, seen.losses(), self.appearance.visible_price(seen.iteration))

    def hidden(self, view: int, size: Size, render: Callable[[], Image]) -> Plane:
        """See PixelWeights: 1 - m."""
        return self.appearance.hidden(view, size)


def visibility_loss(visible: Tensor, losses: Tensor, price: float) -> tuple[Tensor, Tensor]:
    """mean(m l) + price mean((1 - m)^2), and m at the loss's size.

    Args:
        visible: m [h, w] in [0, 1].
        losses: l [H, W], what each pixel adds to the photometric loss.
        price: of what is not seen.
    """
    whole = at_size(visible, (losses.shape[0], losses.shape[1]))
    return (whole * losses).mean() + price * ((1 - visible) ** 2).mean(), whole


def learn_visibility(visible: Tensor, losses: Plane, price: float) -> Plane:
    """The weights [H, W] that a mask gives to the pixels; its gradient is added to `visible.grad`."""
    loss, whole = visibility_loss(visible, torch.from_numpy(losses).to(visible), price)
    loss.backward()
    weights: NDArray = whole.detach().cpu().numpy()
    return weights
