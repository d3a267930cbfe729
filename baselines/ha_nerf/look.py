"""The look of a photograph: a network E looks at the whole of it, small, and says some numbers for the colour head.

E(I) = linear(mean over the picture of convolutions(I)), without normalisation: a batch is one picture.
"""

import math
from itertools import pairwise

import numpy as np
import torch
from torch import Tensor, nn

from baselines.ha_nerf.config import LookConfig
from baselines.training.images import TrainingImages
from baselines.volumetric.encodings import linear


class LookEncoder(nn.Module):
    """E, of a photograph to its look."""

    def __init__(self, config: LookConfig, generator: torch.Generator):
        super().__init__()
        self.entry = convolution(3, config.channels[0], 7, 1, 3, generator)
        halving = [convolution(a, b, 4, 2, 1, generator) for a, b in pairwise(config.channels)]
        self.halving = nn.ModuleList(halving)
        self.exit = linear(config.channels[-1], config.size, generator)

    def forward(self, pictures: Tensor) -> Tensor:
        """The looks [N, E] of pictures [N, 3, S, S] in [-1, 1]."""
        x = self.entry(pictures).relu()
        for layer in self.halving:
            x = layer(x).relu()
        looks: Tensor = self.exit(x.mean((2, 3)))
        return looks


def convolution(inputs: int, outputs: int, side: int, stride: int, pad: int, generator: torch.Generator) -> nn.Conv2d:
    """A convolution over reflected borders; its start is drawn as that of `linear`."""
    layer = nn.Conv2d(inputs, outputs, side, stride, pad, padding_mode="reflect")
    bound = math.sqrt(6 / (inputs * side**2))
    with torch.no_grad():
        layer.weight.uniform_(-bound, bound, generator=generator)
        assert layer.bias is not None
        layer.bias.zero_()
    return layer


def small_pictures(images: TrainingImages, side: int) -> Tensor:
    """Photographs as E sees them: squares [V, 3, side, side] of 8 bits a channel; what is hidden of one is black."""
    pictures = [images.pixels(index, (side, side)) for index in range(len(images))]
    return torch.from_numpy(np.stack(pictures)).permute(0, 3, 1, 2).contiguous()


def as_seen(pictures: Tensor) -> Tensor:
    """Values of 8 bits as numbers in [-1, 1]."""
    return pictures.float() / 127.5 - 1


def rays_of_the_mean(rays: int, share: float, device: torch.device) -> Tensor:
    """Which of a step's rays [R] get the mean look: a share of them, spread evenly."""
    steps = torch.arange(rays + 1, dtype=torch.float64, device=device).mul(share).floor()
    return steps.diff() > 0
