"""The look of a photograph: a network E looks at the whole of it, small, and says some numbers for the colour head.

E(I) = linear(mean over the picture of convolutions(I)), without normalisation: a batch is one picture.
"""

import math
from itertools import pairwise

import torch
from torch import Tensor, nn

from baselines.ha_nerf.config import LookConfig
from baselines.training.images import Size, TrainingImages
from baselines.volumetric.encodings import linear


class LookEncoder(nn.Module):
    """E, of a photograph to its look."""

    def __init__(self, config: LookConfig, generator: torch.Generator):
        super().__init__()
        self.entry = convolution(3, config.channels[0], 7, 1, 3, generator)
        halving = [convolution(a, b, 4, 2, 1, generator) for a, b in pairwise(config.channels)]
        self.halving = nn.ModuleList(halving)
        self.exit = linear(config.channels[-1], config.size, generator)

    def forward(self, picture: Tensor) -> Tensor:
        """The look [E] of a picture [3, H, W] in [-1, 1], of the size that `small_size` says."""
        x = self.entry(picture[None]).relu()
        for layer in self.halving:
            x = layer(x).relu()
        look: Tensor = self.exit(x.mean((2, 3)))[0]
        return look


def convolution(inputs: int, outputs: int, side: int, stride: int, pad: int, generator: torch.Generator) -> nn.Conv2d:
    """A convolution over reflected borders; its start is drawn as that of `linear`."""
    layer = nn.Conv2d(inputs, outputs, side, stride, pad, padding_mode="reflect")
    bound = math.sqrt(6 / (inputs * side**2))
    with torch.no_grad():
        layer.weight.uniform_(-bound, bound, generator=generator)
        assert layer.bias is not None
        layer.bias.zero_()
    return layer


def small_size(size: Size, config: LookConfig) -> Size:
    """The size at which E sees a picture: never larger, but large enough that no border is reflected onto itself."""
    smallest = max(4, 2 ** (len(config.channels) - 1))
    scale = min(1.0, config.longest / max(size))
    return max(smallest, round(scale * size[0])), max(smallest, round(scale * size[1]))


def small_pictures(images: TrainingImages, config: LookConfig) -> list[Tensor]:
    """The photographs as E sees them, [3, h, w] with 8 bits a channel; what is hidden of one is black."""
    shapes = [images.pixels(index).shape for index in range(len(images))]
    sizes = [small_size((height, width), config) for height, width, _ in shapes]
    pictures = [torch.from_numpy(images.pixels(index, size)) for index, size in enumerate(sizes)]
    return [picture.permute(2, 0, 1).contiguous() for picture in pictures]


def as_seen(picture: Tensor) -> Tensor:
    """Values of 8 bits as numbers in [-1, 1]."""
    return picture.float() / 127.5 - 1


def rays_of_the_mean(rays: int, share: float, device: torch.device) -> Tensor:
    """Which of a step's rays [R] get the mean look: a share of them, spread evenly."""
    steps = torch.arange(rays + 1, dtype=torch.float64, device=device).mul(share).floor()
    return steps.diff() > 0
