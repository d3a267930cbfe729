"""The style of a photograph: a network E turns the whole of it, small, into a map of features."""

import torch
from torch import Tensor, nn

from baselines.cr_nerf.config import StyleConfig
from baselines.volumetric.rays.photographs import convolution

MAP_SHARE = 4  # a style map's side is this fraction of the picture's (the authors)
SLOPE = 0.2  # of LeakyReLU where its input is negative
START = 0.1  # of the usual start of the last layer: at first photographs hardly differ in style


class StyleEncoder(nn.Module):
    """E, of a photograph to its style map S, in three stages of which each but the first halves the picture."""

    def __init__(self, config: StyleConfig, features: int, generator: torch.Generator):
        super().__init__()
        first, second, third = config.channels
        self.colours = convolution(3, 3, 1, 1, 0, generator)
        self.first = nn.ModuleList(convolution(a, first, 3, 1, 1, generator) for a in (3, first))
        self.second = nn.ModuleList(convolution(a, second, 3, 1, 1, generator) for a in (first, second))
        self.third = nn.ModuleList([convolution(second, third, 3, 1, 1, generator)])
        self.to_map = nn.AdaptiveAvgPool2d(config.side // MAP_SHARE)
        self.exit = convolution(third, features, 1, 1, 0, generator)
        with torch.no_grad():
            self.exit.weight.mul_(START)

    def forward(self, pictures: Tensor) -> Tensor:
        """Style maps [N, h w, C], place after place, of pictures [N, 3, S, S] in [-1, 1]."""
        x = self.colours(pictures).contiguous(memory_format=torch.channels_last)
        for stage in (self.first, self.second, self.third):
            if stage is not self.first:
                x = nn.functional.max_pool2d(x, 2)
            for layer in stage:
                x = nn.functional.leaky_relu(layer(x), SLOPE)
        maps: Tensor = nn.functional.leaky_relu(self.exit(self.to_map(x)), SLOPE)
        return maps.flatten(2).transpose(1, 2)
