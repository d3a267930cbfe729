"""What fields share that learn from whole photographs: small pictures, convolutions, which rays see the mean look."""

import math

import numpy as np
import torch
from torch import Tensor, nn

from baselines.training.images import TrainingImages

AT_ONCE = 16  # pictures, when all are looked at


def convolution(
    inputs: int, outputs: int, side: int, stride: int, pad: int, generator: torch.Generator, dilation: int = 1
) -> nn.Conv2d:
    """A convolution over reflected borders; its start is drawn as that of `linear`."""
    layer = nn.Conv2d(inputs, outputs, side, stride, pad, dilation, padding_mode="reflect")
    bound = math.sqrt(6 / (inputs * side**2))
    with torch.no_grad():
        layer.weight.uniform_(-bound, bound, generator=generator)
        assert layer.bias is not None
        layer.bias.zero_()
    return layer


def small_pictures(images: TrainingImages, side: int) -> Tensor:
    """Photographs as squares [V, 3, side, side] of 8 bits a channel; what is hidden of one is black."""
    pictures = [images.pixels(index, (side, side)) for index in range(len(images))]
    return torch.from_numpy(np.stack(pictures)).permute(0, 3, 1, 2).contiguous()


def as_seen(pictures: Tensor) -> Tensor:
    """Values of 8 bits as numbers in [-1, 1]."""
    return pictures.float() / 127.5 - 1


def rays_of_the_mean(rays: int, share: float, device: torch.device) -> Tensor:
    """Which of a step's rays [R] get the mean look: a share of them, spread evenly."""
    steps = torch.arange(rays + 1, dtype=torch.float64, device=device).mul(share).floor()
    return steps.diff() > 0
