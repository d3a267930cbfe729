"""From what a Gaussian is and what a picture makes of it to its colour (GS-W).

    encoder(position, dynamic, intrinsic) -> fused
    decoder(fused, intrinsic) -> fused
    colour(fused, direction) -> rgb

The intrinsic feature is the Gaussian's own. Ours is the spherical harmonics of a colour besides, to which is added what
the networks say, whose last layer begins at zero: so the first picture has the points' colours, as that of plain
splatting, and how a Gaussian looks from here and there need not pass through a network that all share. The paper has
the networks alone.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from baselines.gs_w.config import ReferenceConfig
from baselines.splatting.kernels.sh_coefficients import C0, coefficients
from baselines.volumetric.encodings import positional
from hydroviews.scene.cameras import Camera


def layers(inputs: int, hidden: Sequence[int], outputs: int) -> nn.Sequential:
    """Linear layers with rectifiers between them."""
    parts: list[nn.Module] = []
    for a, b in pairwise((inputs, *hidden, outputs)):
        linear = nn.Linear(a, b)
        nn.init.xavier_uniform_(linear.weight)
        nn.init.zeros_(linear.bias)
        parts += [linear, nn.ReLU()]
    return nn.Sequential(*parts[:-1])


class Fusion(nn.Module):
    """Colours of Gaussians; the cube that positions are relative to is part of the state."""

    def __init__(self, config: ReferenceConfig, sh_degree: int) -> None:
        super().__init__()
        self.frequencies = config.frequencies
        intrinsic, position = 3 * coefficients(sh_degree), 3 * (1 + 2 * config.frequencies)
        self.encoder = layers(position + config.dynamic + intrinsic, config.encoder, config.fused)
        self.decoder = layers(config.fused + intrinsic, config.decoder, config.fused)
        self.colour = layers(config.fused + 3, config.colour, 3)
        for parameter in self.colour[-1].parameters():
            nn.init.zeros_(parameter)
        self.middle: Tensor
        self.side: Tensor
        self.register_buffer("middle", torch.zeros(3))  # of the cube, relative to the Gaussians' origin
        self.register_buffer("side", torch.ones(()))  # half of its length

    def forward(self, intrinsic: Tensor, dynamic: Tensor, means: Tensor, directions: Tensor) -> Tensor:
        """What is added to the intrinsic colours [n, 3].

        Args:
            intrinsic: [n, I].
            dynamic: [n, D].
            means: positions [n, 3].
            directions: from the camera, of length one [n, 3].
        """
        positions = positional((means - self.middle) / self.side, self.frequencies)
        fused = functional.relu(self.encoder(torch.cat([positions, dynamic, intrinsic], dim=1)))
        fused = functional.relu(self.decoder(torch.cat([fused, intrinsic], dim=1)))
        offset: Tensor = self.colour(torch.cat([fused, directions], dim=1))
        return offset

    def coloured(self, parameters: dict[str, Tensor], camera: Camera, dynamic: Tensor) -> Tensor:
        """Coefficients [n, K, 3] that Gaussians in sight show to a camera: their own, and an offset of degree 0.

        No gradient goes by way of colours to positions: that by where splats lie is left to place them.

        Args:
            parameters: of `Gaussians.state_dict()`.
            camera: of the view, relative to the Gaussians' origin.
            dynamic: features [n, D].
        """
        means, sh = parameters["means"].detach(), parameters["sh"]
        directions = functional.normalize(means - torch.from_numpy(camera.centre).to(means), dim=1)
        offset = self(sh.flatten(1), dynamic, means, directions)[:, None] / C0
        return torch.cat([sh[:, :1] + offset, sh[:, 1:]], dim=1)

    def enclose(self, points: NDArray[np.float32]) -> None:
        """Make positions relative to a cube that holds 95 % of the points [N, 3] along each axis."""
        low, high = np.quantile(points, 0.025, axis=0), np.quantile(points, 0.975, axis=0)
        self.middle.copy_(torch.from_numpy((low + high) / 2))
        self.side.fill_(max(float((high - low).max()) / 2, 1e-6))
