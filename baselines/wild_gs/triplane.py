"""Points with colours as three planes of features, and what a position reads from them (Wild-GS).

Planes are xy, yz and zx of a box, whose inside reaches from -1 to 1 along each axis. Each is looked at from both sides:
a picture shows the points that are nearest to its side.
"""

import torch
from torch import Tensor, nn
from torch.nn import functional

from baselines.encoders.sampling import sample
from baselines.encoders.unet import Up

PLANES = 3
WIDTHS = (8, 16, 32)  # channels of the U-Net at 1, 1/2 and 1/4 of a plane's side; ours
CHANNELS = 16  # of a plane's features; ours
VALUES = 4  # of a pixel: three of colour, and whether there is a point


def plane_pictures(points: Tensor, colours: Tensor, counted: Tensor, side: int) -> Tensor:
    """The six pictures as three of twice the channels [3, 8, side, side]: from above, then from behind.

    Colours are relative to the middle, 0 where no point is. A pixel's colour is the mean of the points that are within
    one pixel's length of the first one that is met.

    Args:
        points: in the box's units [P, 3], finite.
        colours: of values in [0, 1], [P, 3].
        counted: which of the points there are, bool [P]; those beyond the box are left out besides.
        side: of a picture in pixels.
    """
    across, height = _projections(points)
    cells = ((across + 1) / 2 * side).floor().clamp(0, side - 1).long()  # [P, 3, 2]
    pixels = cells[..., 1] * side + cells[..., 0] + side**2 * torch.arange(PLANES, device=points.device)
    both = torch.cat([pixels, pixels + PLANES * side**2], dim=1).flatten()  # [P * 6]
    toward = torch.cat([height, -height], dim=1).flatten()
    there = (counted & (points.abs() <= 1).all(dim=1)).repeat_interleave(2 * PLANES)
    first = toward.new_full((2 * PLANES * side**2,), -torch.inf)
    first = first.scatter_reduce(0, both, toward.masked_fill(~there, -torch.inf), "amax")
    seen = (there & (toward >= first[both] - 2 / side)).to(colours)
    values = functional.pad(colours - 0.5, (0, 1), value=1.0).repeat_interleave(2 * PLANES, dim=0) * seen[:, None]
    sums = values.new_zeros(2 * PLANES * side**2, VALUES).index_add_(0, both, values)
    count = sums[:, VALUES - 1 :]
    pictures = torch.cat([sums[:, :-1] / count.clamp(min=1), count.clamp(max=1)], dim=1)
    return pictures.reshape(2, PLANES, side, side, VALUES).permute(1, 0, 4, 2, 3).reshape(PLANES, -1, side, side)


def _projections(points: Tensor) -> tuple[Tensor, Tensor]:
    """Places [P, 3, 2] of points on the planes xy, yz and zx, and heights [P, 3] above them."""
    x, y, z = points.unbind(dim=1)
    return torch.stack([x, y, y, z, z, x], dim=1).unflatten(1, (PLANES, 2)), torch.stack([z, x, y], dim=1)


def read(planes: Tensor, positions: Tensor) -> Tensor:
    """Sums [n, C] of what three planes [3, C, h, w] have at positions [n, 3], bilinear; at the border beyond it."""
    across, _ = _projections(positions)
    return sample(planes, across).unflatten(1, (PLANES, -1)).sum(dim=1)


class TriplaneNetwork(nn.Module):
    """A small U-Net that turns the pictures of a plane into its features; all three planes share it."""

    def __init__(self, widths: tuple[int, int, int] = WIDTHS, outputs: int = CHANNELS) -> None:
        super().__init__()
        fine, middle, coarse = widths
        self.first = nn.Conv2d(2 * VALUES, fine, 3, 1, 1)
        self.downs = nn.ModuleList(nn.Conv2d(a, b, 3, 2, 1) for a, b in ((fine, middle), (middle, coarse)))
        self.ups = nn.ModuleList(Up(a, b, b, 1) for a, b in ((coarse, middle), (middle, fine)))
        self.head = nn.Conv2d(fine, outputs, 1)

    def forward(self, pictures: Tensor) -> Tensor:
        """[3, 8, side, side] to [3, outputs, side, side]."""
        levels = [functional.leaky_relu(self.first(pictures), 0.1)]
        for down in self.downs:
            levels.append(functional.leaky_relu(down(levels[-1]), 0.1))
        x = levels.pop()
        for up in self.ups:
            x = up(x, levels.pop())
        planes: Tensor = self.head(x)
        return planes
