"""The look of a photograph: a network E looks at the whole of it, small, and says some numbers for the colour head.

E(I) = linear(mean over the picture of convolutions(I)), without normalisation: a batch is one picture.
"""

from itertools import pairwise

import torch
from torch import Tensor, nn

from baselines.ha_nerf.config import LookConfig
from baselines.volumetric.fields.encodings import linear
from baselines.volumetric.rays.photographs import convolution


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
