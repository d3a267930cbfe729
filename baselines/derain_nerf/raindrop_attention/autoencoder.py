"""A dry picture from a rainy one and the map of its drops: an autoencoder with a wide view and three outputs."""

from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional

DILATIONS = (2, 4, 8, 16)
MULTIPLE = 4  # what height and width are multiples of


class Frames(NamedTuple):
    """A picture at three resolutions."""

    quarter: Tensor  # [N, 3, H / 4, W / 4]
    half: Tensor  # [N, 3, H / 2, W / 2]
    whole: Tensor  # [N, 3, H, W]


class ContextualAutoencoder(nn.Module):
    """Qian et al. 2018, section 3.1: down to a fourth, dilated convolutions, up again with skips."""

    def __init__(self, width: int) -> None:
        super().__init__()
        half, quarter = 2 * width, 4 * width
        self.enter = nn.Conv2d(4, width, 5, padding=2)
        self.down_half = nn.Conv2d(width, half, 3, stride=2, padding=1)
        self.near_half = nn.Conv2d(half, half, 3, padding=1)
        self.down_quarter = nn.Conv2d(half, quarter, 3, stride=2, padding=1)
        self.near_quarter = nn.ModuleList(nn.Conv2d(quarter, quarter, 3, padding=1) for _ in range(2))
        self.wide = nn.ModuleList(nn.Conv2d(quarter, quarter, 3, padding=d, dilation=d) for d in DILATIONS)
        self.back = nn.ModuleList(nn.Conv2d(quarter, quarter, 3, padding=1) for _ in range(2))
        self.up_half = nn.ConvTranspose2d(quarter, half, 4, stride=2, padding=1)
        self.back_half = nn.Conv2d(half, half, 3, padding=1)
        self.up_whole = nn.ConvTranspose2d(half, width, 4, stride=2, padding=1)
        self.back_whole = nn.Conv2d(width, width // 2, 3, padding=1)
        self.outputs = nn.ModuleList(nn.Conv2d(c, 3, 3, padding=1) for c in (quarter, half, width // 2))

    def forward(self, picture: Tensor, attention: Tensor) -> Frames:
        """What it makes of pictures [N, 3, H, W] and their maps [N, 1, H, W]; not bounded."""
        whole = functional.relu(self.enter(torch.cat([picture, attention], dim=1)))
        half = functional.relu(self.near_half(functional.relu(self.down_half(whole))))
        x = functional.relu(self.down_quarter(half))
        for layer in (*self.near_quarter, *self.wide, *self.back):
            x = functional.relu(layer(x))
        quarter = self.outputs[0](x)
        x = functional.relu(self.back_half(functional.relu(self.up_half(x) + half)))
        middle = self.outputs[1](x)
        x = functional.relu(self.back_whole(functional.relu(self.up_whole(x) + whole)))
        return Frames(quarter.float(), middle.float(), self.outputs[2](x).float())

    def quieten(self) -> None:
        """Set every output to zero, so that training starts from the picture they are added to."""
        for parameter in self.outputs.parameters():
            nn.init.zeros_(parameter)


def frames_of(picture: Tensor) -> Frames:
    """A picture [N, 3, H, W], averaged over areas to all three resolutions; H and W multiples of 4."""
    return Frames(functional.avg_pool2d(picture, 4), functional.avg_pool2d(picture, 2), picture)
