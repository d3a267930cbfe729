"""From the look of the whole, of the place, and a Gaussian's own numbers to its colour (Wild-GS).

    sh = the Gaussian's own + colour(global code, local code, intrinsic numbers)

The paper has the network alone. Its last layer begins at zero here, so that the first picture has the points' colours.
"""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from baselines.splatting.appearance.networks import layers
from baselines.splatting.kernels.splats.sh_coefficients import C0, coefficients
from baselines.wild_gs.config import LookConfig
from baselines.wild_gs.triplane import CHANNELS

HIDDEN = 32  # units of the networks of codes and colours
REST = 0.05  # factor on the networks' output for all coefficients but the first
TAIL = 0.01  # of the Gaussians, at each end of an axis, that the extent leaves out


class LookColours(nn.Module):
    """Codes and colours; the box that has a local look is part of the state."""

    def __init__(self, config: LookConfig, sh_degree: int, features: int) -> None:
        """Networks that add nothing yet.

        Args:
            config: settings.
            sh_degree: of the Gaussians' colours.
            features: length of the encoder's.
        """
        super().__init__()
        self.config = config
        self.of_whole = layers(features, (HIDDEN,), config.code)
        self.of_place = layers(CHANNELS, (HIDDEN,), config.code)
        self.outside = nn.Parameter(torch.zeros(config.code))  # the local code of all that has no local look
        self.colour = layers(2 * config.code + config.intrinsic, (HIDDEN,), 3 * coefficients(sh_degree))
        for parameter in self.colour[-1].parameters():
            nn.init.zeros_(parameter)
        self.scale: Tensor  # [K, 1] on what the last layer says
        self.register_buffer("scale", torch.full((coefficients(sh_degree), 1), REST / C0))
        self.scale[0] = 1 / C0
        self.middle: Tensor
        self.reach: Tensor
        self.register_buffer("middle", torch.zeros(3))  # of the box, relative to the Gaussians' origin
        self.register_buffer("reach", torch.ones(3))  # half of its lengths

    def codes(self, whole: Tensor, places: Tensor | None, positions: Tensor) -> Tensor:
        """Global and local codes [n, 2 code].

        Args:
            whole: features of the picture.
            places: what the triplane has at the positions [n, C]; None: nobody has a local look.
            positions: in the box's units [n, 3].
        """
        shared = self.of_whole(whole).expand(len(positions), -1)
        outside = self.outside.expand(len(positions), -1)
        if places is None:
            return torch.cat([shared, outside], dim=1)
        inside = (positions.abs() <= 1).all(dim=1, keepdim=True)
        return torch.cat([shared, torch.where(inside, self.of_place(places), outside)], dim=1)

    def added(self, codes: Tensor, intrinsic: Tensor) -> Tensor:
        """What is added to coefficients [n, K, 3], by codes [n, 2 code] and intrinsic numbers [n, I]."""
        said: Tensor = self.colour(torch.cat([codes, intrinsic], dim=1))
        return said.unflatten(1, (-1, 3)) * self.scale

    def in_box(self, means: Tensor) -> Tensor:
        """Positions [n, 3] in the box's units: -1 to 1 inside."""
        return (means - self.middle) / self.reach

    def enclose(self, points: NDArray[np.float32]) -> None:
        """Lay the box in the middle of the points [N, 3], over its share of their extent along each axis."""
        low, high = np.quantile(points, TAIL, axis=0), np.quantile(points, 1 - TAIL, axis=0)
        self.middle.copy_(torch.from_numpy((low + high) / 2))
        self.reach.copy_(torch.from_numpy(np.maximum(self.config.box * (high - low) / 2, 1e-6)))
