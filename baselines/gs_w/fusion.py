"""From what a Gaussian is and what a picture makes of it to its colour (GS-W).

    encoder(position, dynamic, intrinsic) -> fused
    decoder(fused, intrinsic) -> fused
    colour(fused, direction) -> rgb

The intrinsic feature is the Gaussian's own. Ours is the spherical harmonics of a colour besides, to which is added what
the networks say, whose last layer begins at zero: so the first picture has the points' colours, as that of plain
splatting, and how a Gaussian looks from here and there need not pass through a network that all share. The paper has
the networks alone.
"""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from baselines.gs_w.config import ReferenceConfig
from baselines.splatting.appearance.networks import layers, linear_of_parts
from baselines.splatting.kernels.splats.sh_coefficients import C0, coefficients
from baselines.volumetric.fields.encodings import positional
from hydroviews.scene.cameras import Camera


class Fusion(nn.Module):
    """Colours of Gaussians; the cube that positions are relative to is part of the state."""

    def __init__(self, config: ReferenceConfig, sh_degree: int) -> None:
        super().__init__()
        self.frequencies, self.dynamic = config.frequencies, config.dynamic
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

    def forward(self, intrinsic: Tensor, dynamic: Tensor | None, means: Tensor, directions: Tensor) -> Tensor:
        """What is added to the intrinsic colours [n, 3].

        Args:
            intrinsic: [n, I].
            dynamic: [n, D]; None: zeros.
            means: positions [n, 3].
            directions: from the camera, of length one [n, 3].
        """
        positions = positional((means - self.middle) / self.side, self.frequencies)
        given = self.dynamic if dynamic is None else dynamic
        fused = functional.relu(self._said(self.encoder, positions, given, intrinsic))
        fused = functional.relu(self._said(self.decoder, fused, intrinsic))
        return self._said(self.colour, fused, directions)

    @staticmethod
    def _said(network: nn.Sequential, *parts: Tensor | int) -> Tensor:
        """What a network says of parts side by side; see `linear_of_parts`."""
        first = network[0]
        assert isinstance(first, nn.Linear)
        said: Tensor = network[1:](linear_of_parts(first, *parts))
        return said

    def coloured(self, parameters: dict[str, Tensor], camera: Camera, dynamic: Tensor | None) -> Tensor:
        """Coefficients [n, K, 3] that Gaussians in sight show to a camera: their own, and an offset of degree 0.

        No gradient goes by way of colours to positions: that by where splats lie is left to place them.

        Args:
            parameters: of `Gaussians.state_dict()`.
            camera: of the view, relative to the Gaussians' origin.
            dynamic: features [n, D]; None: zeros.
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
