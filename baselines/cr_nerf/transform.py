"""From the features that rays have composited to colours: a linear map, by the covariances of content and style.

With F the features of many rays and S a style map, F0 = F - mean F and S0 = S - mean S,

    A(X) = fc(Z^T Z / n),   Z = network(X)                one for content, one for style
    T = A_s(S0) A_c(F0)
    colour = sigmoid(exit(expand(T compress(F0)) + mean S))

so that a ray's colour depends on the other rays by their mean and covariance alone, and on the photograph by mean S and
A_s(S0) alone: the mean style of the training views is the mean of those.
"""

from itertools import pairwise

import torch
from torch import Tensor, nn

from baselines.cr_nerf.config import TransformConfig
from baselines.cr_nerf.style import SLOPE
from baselines.volumetric.fields.encodings import linear


class Mixing(nn.Module):
    """A, of centred features to a matrix; the identity before training, whatever the features."""

    def __init__(self, config: TransformConfig, features: int, generator: torch.Generator):
        super().__init__()
        self.size = config.size
        widths = [features, *config.hidden, config.size]
        self.layers = nn.ModuleList(linear(a, b, generator) for a, b in pairwise(widths))
        self.fc = linear(config.size**2, config.size**2, generator)
        with torch.no_grad():
            self.fc.weight.zero_()
            self.fc.bias.copy_(torch.eye(config.size).flatten())

    def forward(self, centred: Tensor) -> Tensor:
        """Matrices [N, m, m] of N sets [N, n, C]."""
        z = centred
        for layer in self.layers[:-1]:
            z = nn.functional.leaky_relu(layer(z), SLOPE)
        z = self.layers[-1](z)
        covariance = z.transpose(1, 2) @ z / z.shape[1]
        matrices: Tensor = self.fc(covariance.flatten(1))
        return matrices.view(-1, self.size, self.size)


class CrossRayTransform(nn.Module):
    """What is done to centred features with a given matrix and style; with T = 1 it starts as a projection of them."""

    def __init__(self, config: TransformConfig, features: int, generator: torch.Generator):
        super().__init__()
        self.compress = linear(features, config.size, generator)
        self.expand = linear(config.size, features, generator)
        self.exit = linear(features, 3, generator)
        with torch.no_grad():  # so that expanding undoes compressing as far as m dimensions hold C
            axes = torch.linalg.qr(torch.randn(features, config.size, generator=generator)).Q
            self.compress.weight.copy_(axes.T)
            self.expand.weight.copy_(axes)

    def forward(self, centred: Tensor, matrices: Tensor, styles: Tensor) -> Tensor:
        """Colours [R, 3] in [0, 1] of centred features [R, C], with matrices T [R, m, m] and mean S [R, C].

        Matrix and style may be one for all rays, [1, m, m] and [1, C].
        """
        mixed = (matrices @ self.compress(centred)[..., None])[..., 0]
        return torch.sigmoid(self.exit(self.expand(mixed) + styles))
