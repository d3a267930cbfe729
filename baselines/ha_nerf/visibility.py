"""What is in one photograph alone: a network says of each of its pixels how far it is hidden from the scene.

m(i, u, v) in [0, 1], 1 for what comes and goes, from a learned code of view i and the place in the picture. It never
sees a colour: what it hides it has to remember, view by view and place by place.
"""

import math
from itertools import pairwise

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from baselines.ha_nerf.config import VisibilityConfig
from baselines.masking.rays import pixel_places
from baselines.volumetric.fields.encodings import linear, positional


class Visibility(nn.Module):
    """The network of the masks, with a code for every training view."""

    def __init__(self, config: VisibilityConfig, views: int, generator: torch.Generator):
        super().__init__()
        self.octaves = config.octaves
        self.codes = nn.Parameter(torch.randn(views, config.code, generator=generator))
        inputs = config.code + 2 * (1 + 2 * config.octaves)
        widths = [inputs, *[config.width] * config.layers]
        self.layers = nn.ModuleList(linear(a, b, generator) for a, b in pairwise(widths))
        self.exit = linear(config.width, 1, generator)
        with torch.no_grad():
            self.exit.weight.zero_()
            self.exit.bias.fill_(math.log(config.at_first / (1 - config.at_first)))

    def forward(self, views: Tensor, places: Tensor) -> Tensor:
        """m [R] for views [R] and places [R, 2], row and column in [0, 1]."""
        codes = nn.functional.embedding(views, self.codes)
        hidden = torch.cat([codes, positional(places, self.octaves)], 1)
        for layer in self.layers:
            hidden = layer(hidden).relu_()
        m: Tensor = torch.sigmoid(self.exit(hidden)[:, 0])
        return m

    def plane(self, view: int, size: tuple[int, int]) -> NDArray[np.float32]:
        """m [H, W] of a view at (height, width), row by row."""
        device = self.codes.device
        views = torch.full((size[1],), view, device=device)
        return torch.stack([self(views, row) for row in pixel_places(size, device)]).cpu().numpy()
