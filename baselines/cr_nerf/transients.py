"""What is in one photograph alone: a network says of every place of a photograph how far the scene is hidden there.

It sees the photograph and has no code of the view: it masks what looks like something that comes and goes, the same in
all views.
"""

import math

import torch
from torch import Tensor, nn

from baselines.cr_nerf.config import TransientConfig
from baselines.cr_nerf.style import SLOPE
from baselines.volumetric.rays.photographs import convolution


class TransientNetwork(nn.Module):
    """Dilated convolutions at half the picture's size, each added to what came before."""

    def __init__(self, config: TransientConfig, generator: torch.Generator):
        super().__init__()
        width = config.channels
        self.entry = convolution(3, width, 3, 2, 1, generator)
        self.dilated = nn.ModuleList(convolution(width, width, 3, 1, d, generator, d) for d in config.dilations)
        self.exit = convolution(width, 1, 1, 1, 0, generator)
        with torch.no_grad():
            self.exit.weight.zero_()
            assert self.exit.bias is not None
            self.exit.bias.fill_(math.log(config.at_first / (1 - config.at_first)))

    def forward(self, pictures: Tensor) -> Tensor:
        """Masks m [N, S / 2, S / 2] in [0, 1] of pictures [N, 3, S, S] in [-1, 1]."""
        x = pictures.contiguous(memory_format=torch.channels_last)
        x = nn.functional.leaky_relu(self.entry(x), SLOPE)
        for layer in self.dilated:
            x = x + nn.functional.leaky_relu(layer(x), SLOPE)
        return torch.sigmoid(self.exit(x))[:, 0]


def read(masks: Tensor, which: Tensor, places: Tensor) -> Tensor:
    """Masks [N, h, w] read at places [R, 2], row and column in (0, 1), of mask `which` [R] each; bilinear.

    Beyond the centres of the outermost values those are kept.
    """
    size = torch.tensor(masks.shape[1:], device=masks.device)
    where = (places * size - 0.5).clamp_min(0).minimum(size - 1.0)
    low = where.long()
    high = (low + 1).minimum(size - 1)
    (row, column), (below, right) = low.T, high.T
    down, across = (where - low).T
    upper = torch.lerp(masks[which, row, column], masks[which, row, right], across)
    lower = torch.lerp(masks[which, below, column], masks[which, below, right], across)
    return torch.lerp(upper, lower, down)
