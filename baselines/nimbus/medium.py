"""A medium in space, which dims what lies behind it and adds light of one colour (NimbusGS, 2026).

    extinction = softplus(f) exp(s)                       of a grid's points, trilinear between them, 0 outside its box
    T = exp(-integral of the extinction along the ray)
    P = integral of T extinction A = A (1 - T)            as the airlight A is the same everywhere
    A = (tanh(a) + 1) / 2

The scene R is seen as R T + P. Extinction is per `unit`, a length of the scene.
"""

import math

import torch
from torch import Tensor, nn
from torch.nn import functional

from baselines.encoders.unet import at_size
from baselines.nimbus.config import MediumConfig
from baselines.nimbus.view_rays import Box, Rays

SPREAD = 0.01  # standard deviation of f at the start (the paper)
CLEAR = 0.05  # optical depth at the start over one unit: nearly clear air; ours
SAMPLES = 32  # per ray (the paper)
DENSEST = 10.0  # of s, so that no extinction is infinite


class Medium(nn.Module):
    """A grid of extinction in a box, and the airlight."""

    def __init__(self, config: MediumConfig, box: Box, seed: int, samples: int = SAMPLES) -> None:
        """Nearly clear air.

        Args:
            config: settings.
            box: where the grid lies, and the unit of its extinction.
            seed: of the first values.
            samples: per ray.
        """
        super().__init__()
        self.box, self.samples = box, samples
        drawn = torch.randn((config.cells,) * 3, generator=torch.Generator().manual_seed(seed))
        self.field = nn.Parameter(SPREAD * drawn)  # f, by z, y and x
        self.log_scale = nn.Parameter(torch.tensor(math.log(CLEAR / math.log(2))))  # s; softplus(0) is log(2)
        self.raw_airlight = nn.Parameter(torch.zeros(3))  # a

    @property
    def extinction(self) -> Tensor:
        """Of the grid's points [n, n, n], by z, y and x, per unit."""
        return functional.softplus(self.field) * self.log_scale.clamp(max=DENSEST).exp()

    @property
    def airlight(self) -> Tensor:
        """A [3], encoded, in (0, 1)."""
        return (self.raw_airlight.tanh() + 1) / 2

    def transmission(self, rays: Rays, extinction: Tensor | None = None) -> Tensor:
        """T [P] in [0, 1] of rays.

        Args:
            rays: on the medium's device.
            extinction: of the grid, where it is known already.
        """
        grid = self.extinction if extinction is None else extinction
        first, length = rays.inside()
        steps = (torch.arange(self.samples, device=length.device, dtype=length.dtype) + 0.5) / self.samples
        along = first[:, None] + steps * length[:, None]
        positions = rays.origin + along[..., None] * rays.directions[:, None]
        read = functional.grid_sample(
            grid[None, None], positions[None, None], mode="bilinear", padding_mode="border", align_corners=True
        )
        return torch.exp(-read[0, 0, 0].mean(dim=1) * length / self.box.unit)


def through(scene: Tensor, transmission: Tensor, airlight: Tensor) -> Tensor:
    """The scene [H, W, 3] as it is seen through a medium of T [H, W]: R T + A (1 - T)."""
    share = transmission[..., None]
    return scene * share + airlight * (1 - share)


def enlarged(transmission: Tensor, size: tuple[int, int]) -> Tensor:
    """T [h, w] at another size [H, W], bilinear."""
    return transmission if transmission.shape == size else at_size(transmission, size)
