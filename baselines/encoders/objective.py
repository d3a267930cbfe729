"""The loss of methods that encode photographs: photometric under their visibility mask, and unmasked LPIPS."""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from baselines.encoders.appearance import EncodedAppearance
from baselines.masking.visibility import VisibilityMask
from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.objective import Objective
from baselines.training.images import TrainingImages
from hydroviews.metrics.lpips import lpips
from hydroviews.scene.images import Image


class PerceptualObjective(Objective):
    """The photometric loss under the visibility mask, and LPIPS."""

    appearance: EncodedAppearance

    def __init__(self, images: TrainingImages, lambda_dssim: float, appearance: EncodedAppearance) -> None:
        super().__init__(images, lambda_dssim, appearance, VisibilityMask(appearance))

    def __call__(self, image: Image, view: int, iteration: int, buffers: BufferPool) -> tuple[float, Image]:
        """See Objective."""
        loss, gradient = super().__call__(image, view, iteration, buffers)
        weight = self.appearance.config.lpips
        if weight:
            size = image.shape[0], image.shape[1]
            photograph, ignored = self.target(view, size).image, self.images.ignored(view, size)
            value, more = perceptual_loss(image, photograph, ignored, self.appearance.device)
            loss, gradient = loss + weight * value, gradient + weight * more
        return loss, gradient


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
