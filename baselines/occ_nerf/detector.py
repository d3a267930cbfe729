"""The detector: whether what a ray sees first is a foreground, far before what lies behind it."""

from itertools import pairwise

import torch
from torch import Tensor, nn

from baselines.volumetric.fields.encodings import linear

SIZES = 64, 32  # units of the hidden layers
SLOPE = 0.1  # of the rectifiers where they are not one
SMALLEST = 1e-4  # length of a vector that has a direction


class Detector(nn.Module):
    """Foreground or not, from the weights along a ray and its two depths.

    What it is given is detached: its loss moves the detector alone.
    """

    def __init__(self, samples: int, generator: torch.Generator):
        """For rays of so many samples."""
        super().__init__()
        sizes = (samples + 2, *SIZES, 1)
        self.layers = nn.ModuleList(linear(a, b, generator) for a, b in pairwise(sizes))

    def forward(self, weights: Tensor, near: Tensor, behind: Tensor) -> Tensor:
        """m [R] in (0, 1), foreground from 0.5 on, for weights [R, S], depths [R] and depths from behind [R]."""
        values = torch.cat([weights, near[:, None], behind[:, None]], 1).detach()
        for layer in self.layers[:-1]:
            values = nn.functional.leaky_relu(layer(values), SLOPE)
        return torch.sigmoid(self.layers[-1](values)[:, 0])


def correlation_loss(m: Tensor, gaps: Tensor, threshold: float, counts: Tensor) -> Tensor:
    """1 - cos(m - 0.5, gaps - threshold) over R rays, each as far as it counts.

    Nothing is centred: a batch without any foreground is right with every m below 0.5. A vector of next to no length
    has no direction, and leaves the loss at 1.

    Args:
        m: of the detector [R].
        gaps: depth from behind less depth [R].
        threshold: gap from which on there is a foreground.
        counts: [R] in [0, 1].
    """
    one, other = counts * (m - 0.5), counts * (gaps.detach() - threshold)
    return 1 - (one * other).sum() / (_length(one) * _length(other))


def _length(vector: Tensor) -> Tensor:
    """Its length, but for a bound below, smooth so that the gradient is finite at zero."""
    return (vector.square().sum() + SMALLEST**2).sqrt()
