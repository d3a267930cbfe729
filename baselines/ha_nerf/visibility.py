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
from baselines.volumetric.encodings import linear, positional

GREY = 1 / 12  # squared error of grey for values that are spread evenly: the median before the first step
LEAST = 1e-6  # running medians are taken to be at least this, so that masking always costs something
KEPT = 0.5  # of a running value after every view was visited once more


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
        height, width = size
        columns = (torch.arange(width, device=self.codes.device) + 0.5) / width
        views = torch.full((width,), view, device=self.codes.device)
        rows = [torch.stack([torch.full_like(columns, (y + 0.5) / height), columns], 1) for y in range(height)]
        return torch.stack([self(views, places) for places in rows]).cpu().numpy()


class Running(nn.Module):
    """What training has seen of late: a typical error, and how much is masked."""

    def __init__(self, views: int, photographs: int, at_first: float):
        super().__init__()
        self.kept = KEPT ** (photographs / views)  # a step
        self.visits_a_step = photographs / views
        self.typical: Tensor  # median of the squared errors
        self.masked: Tensor  # mean of m
        self.steps: Tensor
        self.register_buffer("typical", torch.tensor(GREY))
        self.register_buffer("masked", torch.tensor(at_first))
        self.register_buffer("steps", torch.tensor(0))

    @torch.no_grad()
    def observe(self, errors: Tensor, m: Tensor, counts: Tensor) -> None:
        """Take in a step's squared errors [R] and masks [R], of those that count (bool [R])."""
        self.steps += 1
        if counts.any():
            self.typical.lerp_(errors[counts].median(), 1 - self.kept)
            self.masked.lerp_(m[counts].mean(), 1 - self.kept)

    @property
    def visits(self) -> float:
        """How often each view was visited so far, on average."""
        return float(self.steps) * self.visits_a_step


def price_of_masking(config: VisibilityConfig, running: Running) -> Tensor:
    """lambda_s, the weight of mean(m^2): falls with the visits of each view, and may follow the typical error.

    Where 0.5 (1 - m) e + lambda_s m^2 is smallest, m = e / (4 lambda_s), or 1 if that is more. A relative price of p
    so masks what has a squared error of 4 p times the median, and 1 / (4 p) of what has the median itself.
    """
    price = max(config.price, config.price_at_first * math.exp(-config.price_fall * running.visits))
    unit = running.typical.clamp_min(LEAST) if config.relative else torch.ones_like(running.typical)
    return price * unit
