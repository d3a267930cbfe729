"""Radiance fields on the unit cube: density, features, and from those a colour that depends on the ray.

A field has `geometry(points) -> (density, features)` and `colour(features, directions, embeddings)`; R rays with S
samples each. What is the same for all samples of a ray is put through its layer once and added.
"""

from typing import Protocol

import torch
from torch import Tensor, nn

from baselines.volumetric.config import HashFieldConfig, MlpFieldConfig
from baselines.volumetric.fields.encodings import HARMONICS, harmonics, linear, positional
from baselines.volumetric.fields.hash_grid import HashGrid

LARGEST = 12.0  # of the logarithm of a density
DENSITY_FEATURES = 15  # from the density to the colour network of a hash grid (Mueller et al. 2022, section 5.4)
PROPOSAL_HIDDEN = 16  # units of the hidden layer of a proposal network
DIRECTION_OCTAVES = 4  # of NeRF (Mildenhall et al. 2020, section 5.1)


class Field(Protocol):
    """What fields offer."""

    features: int  # F, how many a sample has

    def geometry(self, points: Tensor) -> tuple[Tensor, Tensor]:
        """Density [R, S] and features [R, S, F] at points [R, S, 3] of the unit cube."""

    def colour(self, features: Tensor, directions: Tensor, embeddings: Tensor | None = None) -> Tensor:
        """Colours [R, S, 3] in [0, 1], seen along unit vectors [R, 3] with embeddings [R, E] of the views.

        A field made with more than three `channels` gives as many of those.
        """


def exponential(values: Tensor) -> Tensor:
    """exp, at most e^12; its gradient does not vanish there, so that what is too dense can thin out again."""
    limited = values + (values.clamp_max(LARGEST) - values).detach()
    return limited.exp()


class HashField(nn.Module):
    """A hash grid under two tiny networks (Mueller et al. 2022, section 5.4)."""

    def __init__(self, config: HashFieldConfig, embedding_size: int, generator: torch.Generator, channels: int = 3):
        super().__init__()
        hidden, self.features = config.hidden, DENSITY_FEATURES
        self.grid = HashGrid(config.grid, generator)
        self.inner = linear(self.grid.width, hidden, generator)
        self.outer = linear(hidden, 1 + DENSITY_FEATURES, generator)
        self.entry = linear(DENSITY_FEATURES, hidden, generator)
        self.ray_entry = linear(HARMONICS + embedding_size, hidden, generator, bias=False)
        self.middle = nn.ModuleList(linear(hidden, hidden, generator) for _ in range(config.colour_layers - 1))
        self.exit = linear(hidden, channels, generator)

    def geometry(self, points: Tensor) -> tuple[Tensor, Tensor]:
        """See Field."""
        hidden = self.inner(self.grid(points.reshape(-1, 3))).relu_()
        outputs = self.outer(hidden).view(*points.shape[:2], -1)
        return exponential(outputs[..., 0]), outputs[..., 1:]

    def colour(self, features: Tensor, directions: Tensor, embeddings: Tensor | None = None) -> Tensor:
        """See Field."""
        ray = harmonics(directions) if embeddings is None else torch.cat([harmonics(directions), embeddings], 1)
        hidden = (self.entry(features) + self.ray_entry(ray)[:, None]).relu_()
        for layer in self.middle:
            hidden = layer(hidden).relu_()
        return torch.sigmoid(self.exit(hidden))


class ProposalNetwork(nn.Module):
    """Density alone, on a coarser grid: proposes where the field is to be sampled."""

    def __init__(self, config: HashFieldConfig, generator: torch.Generator):
        super().__init__()
        self.grid = HashGrid(config.proposal_grid, generator)
        self.inner = linear(self.grid.width, PROPOSAL_HIDDEN, generator)
        self.outer = linear(PROPOSAL_HIDDEN, 1, generator)

    def density(self, points: Tensor) -> Tensor:
        """Density [R, S] at points [R, S, 3] of the unit cube."""
        hidden = self.inner(self.grid(points.reshape(-1, 3))).relu_()
        return exponential(self.outer(hidden)).view(points.shape[:2])


class MlpField(nn.Module):
    """The network of NeRF (Mildenhall et al. 2020, figure 7), with softplus for densities as in NeRF-W."""

    def __init__(self, config: MlpFieldConfig, embedding_size: int, generator: torch.Generator, channels: int = 3):
        super().__init__()
        self._octaves, self.features = config.position_octaves, config.width
        self._skip = config.depth // 2  # layers after which the encoded position is added again
        width, position = config.width, 3 * (1 + 2 * config.position_octaves)
        inputs = [position] + [width + position * (layer == self._skip) for layer in range(1, config.depth)]
        self.trunk = nn.ModuleList(linear(size, width, generator) for size in inputs)
        self.density = linear(width, 1, generator)
        self.final = linear(width, width, generator)
        self.entry = linear(width, width // 2, generator)
        direction = 3 * (1 + 2 * DIRECTION_OCTAVES)
        self.ray_entry = linear(direction + embedding_size, width // 2, generator, bias=False)
        self.exit = linear(width // 2, channels, generator)

    def geometry(self, points: Tensor) -> tuple[Tensor, Tensor]:
        """See Field."""
        encoded = positional(2 * points - 1, self._octaves)
        hidden = encoded
        for index, layer in enumerate(self.trunk):
            hidden = torch.cat([hidden, encoded], -1) if index == self._skip else hidden
            hidden = layer(hidden).relu_()
        return nn.functional.softplus(self.density(hidden)[..., 0]), self.final(hidden)

    def colour(self, features: Tensor, directions: Tensor, embeddings: Tensor | None = None) -> Tensor:
        """See Field."""
        encoded = positional(directions, DIRECTION_OCTAVES)
        ray = encoded if embeddings is None else torch.cat([encoded, embeddings], 1)
        return torch.sigmoid(self.exit((self.entry(features) + self.ray_entry(ray)[:, None]).relu_()))
