"""What GS-W's renders are compared with: the photographs, where its visibility mask m has the scene seen.

    L = mean(m l) + price mean((1 - m)^2),      l = (1 - lambda) |C^ - C| + lambda (1 - SSIM) of every pixel

Free to choose, m would end at 1 - l / (2 price), not below 0. The authors' code multiplies both pictures by m before it
compares them; weighing each pixel's loss differs at the edges of SSIM's windows alone. The paper adds LPIPS, unmasked.
"""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from baselines.gs_w.encoded import EncodedAppearance
from baselines.gs_w.encoder import at_size
from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.kernels.loss_map import loss_map
from baselines.splatting.kernels.photometric import photometric_loss
from baselines.splatting.objective import Objective
from baselines.training.images import TrainingImages
from hydroviews.metrics.lpips import lpips
from hydroviews.scene.images import Image


class VisibleObjective(Objective):
    """The photometric loss under the mask, which learns from the same loss."""

    appearance: EncodedAppearance

    def __init__(self, images: TrainingImages, lambda_dssim: float, appearance: EncodedAppearance) -> None:
        super().__init__(images, lambda_dssim, appearance)
        self.first = round(appearance.config.visible_from * appearance.iterations)

    def __call__(self, image: Image, view: int, iteration: int, buffers: BufferPool) -> tuple[float, Image]:
        """See Objective; gradients by the mask are left where `EncodedAppearance.learn` finds them."""
        target = self.target(view, (image.shape[0], image.shape[1]))
        weights = None
        if iteration >= self.first:
            losses = loss_map(image, target, self.lambda_dssim, buffers)
            weights = learn_visibility(self.appearance.visible, losses, self.appearance.visible_price(iteration))
        loss, gradient = photometric_loss(image, target, self.lambda_dssim, weights, buffers)
        if self.appearance.config.lpips:
            ignored = self.images.ignored(view, (image.shape[0], image.shape[1]))
            value, more = perceptual_loss(image, target.image, ignored, self.appearance.device)
            loss, gradient = loss + self.appearance.config.lpips * value, gradient + self.appearance.config.lpips * more
        return loss, gradient

    def hidden(self, view: int, size: tuple[int, int]) -> NDArray[np.float32]:
        """See Objective: 1 - m."""
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


def learn_visibility(visible: Tensor, losses: NDArray[np.float32], price: float) -> NDArray[np.float32]:
    """The weights [H, W] that a mask gives to the pixels; its gradient is added to `visible.grad`."""
    loss, whole = visibility_loss(visible, torch.from_numpy(losses).to(visible), price)
    loss.backward()
    return whole.detach().cpu().numpy()


def perceptual_loss(
    image: Image,
    photograph: Image,
    ignored: NDArray[np.bool_] | None = None,
    device: torch.device | None = None,
) -> tuple[float, NDArray[np.float32]]:
    """LPIPS (VGG) of two pictures [H, W, 3], calculated on a device, and its gradient by the first."""
    leaf, fixed = (torch.from_numpy(np.array(picture)).to(device) for picture in (image, photograph))
    leaf.requires_grad_()
    pictures = [x.clamp(0, 1).permute(2, 0, 1)[None] for x in (leaf, fixed)]
    hidden = None if ignored is None else torch.from_numpy(ignored)[None].to(device)
    score = lpips(pictures[0], pictures[1], "vgg", hidden)
    assert isinstance(score, Tensor)
    score.sum().backward()
    assert leaf.grad is not None
    return float(score.detach()), leaf.grad.cpu().numpy()
