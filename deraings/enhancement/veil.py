"""What a smooth veil explains of a rainy picture: mist on the lens, and the haze of rain too dense to be seen singly.

A network looks at the whole picture, however large, squeezed to 128x128 pixels, and says how much of each place's
light is veiled, and by what light. Where mist is thick follows from what a picture lacks, such as dark and saturated
places, and from where it lacks them; a network that sees parts of pictures does not learn that. The veil is then
taken off by inverting I = (1 - V) B + V w in linear light, which costs the following network nothing.
"""

import torch
from torch import Tensor, nn
from torch.nn import functional

SIDE, CELL = 128, 8  # pixels of the squeezed picture, and of a cell whose statistics the network sees
FINE = 2  # pixels; smallest values are also averaged over parts of a cell, which a dark speck does not change
STATISTICS = 20  # 6 of each channel, and the place
LAYERS = 5
THICKEST = 0.97  # of a veil; what is behind a thicker one is lost
COARSE = 4  # pixels of the squeezed picture that the loss averages over
TRUTH = 10.0  # weight of the true veil
FLOOR = 0.02  # encoded; smaller errors hardly count

Box = tuple[float, float, float, float]  # top, bottom, left, right of a part, in shares of the picture's sides


class VeilNetwork(nn.Module):
    """Statistics of a picture's cells in, V and the veil's light out: residual layers that all know the whole."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.start = nn.Conv2d(STATISTICS, width, 1)
        self.near = nn.ModuleList(nn.Conv2d(2 * width, width, 3, padding=1) for _ in range(LAYERS))
        self.far = nn.ModuleList(nn.Linear(3 * width, width) for _ in range(LAYERS))
        self.end = nn.Conv2d(width, 4, 1)

    def forward(self, image: Tensor) -> Tensor:
        """Of pictures [N, 3, H, W], sRGB-encoded: [N, 4, 16, 16], V in (-0.97, 0.97) and the light, linear, (0, 1)."""
        x = functional.relu(self.start(statistics(squeezed(image))))
        for near, far in zip(self.near, self.far, strict=True):
            whole = far(torch.cat([x.mean((2, 3)), x.amax((2, 3)), x.amin((2, 3))], dim=1))
            x = x + functional.relu(near(torch.cat([x, whole[:, :, None, None].expand_as(x)], dim=1)))
        found = self.end(x)
        light = torch.sigmoid(found[:, 1:].mean((2, 3), keepdim=True)).expand(-1, -1, *found.shape[2:])
        return torch.cat([THICKEST * torch.tanh(found[:, :1]), light], dim=1)


def squeezed(image: Tensor) -> Tensor:
    """Pictures [N, 3, H, W] of any size at 128x128, averaged over areas."""
    return functional.adaptive_avg_pool2d(image, SIDE)


def statistics(image: Tensor) -> Tensor:
    """Mean, spread, extremes and texture of the cells of squeezed pictures, and where they are: [N, 20, 16, 16]."""
    mean = functional.avg_pool2d(image, CELL)
    spread = (functional.avg_pool2d(image * image, CELL) - mean * mean).clamp_min(1e-8).sqrt()
    highest = functional.max_pool2d(image, CELL)
    lowest = -functional.max_pool2d(-image, CELL)
    low = functional.avg_pool2d(-functional.max_pool2d(-image, FINE), CELL // FINE)
    steps = functional.pad((image[..., 1:] - image[..., :-1]).abs(), (0, 1))
    texture = functional.avg_pool2d(steps, CELL)
    side = torch.linspace(-0.5, 0.5, mean.shape[-1], dtype=image.dtype, device=image.device)
    place = torch.stack(torch.meshgrid(side, side, indexing="ij")).expand(len(image), -1, -1, -1)
    return torch.cat([mean, 3 * spread, highest, lowest, low, 5 * texture, place], dim=1)


def cut(veil: Tensor, boxes: Tensor, height: int, width: int) -> Tensor:
    """The veils [N, 4, h, w] of parts of pictures, between the cells' middles linear: [N, 4, height, width].

    Args:
        veil: of whole pictures.
        boxes: [N, 4], see `Box`.
        height: pixels of the parts.
        width: the same.
    """
    top, bottom, left, right = (boxes[:, i, None] for i in range(4))
    y = top + (bottom - top) * (torch.arange(height, device=veil.device) + 0.5) / height
    x = left + (right - left) * (torch.arange(width, device=veil.device) + 0.5) / width
    grid = torch.stack([x[:, None, :].expand(-1, height, -1), y[:, :, None].expand(-1, -1, width)], dim=-1)
    return functional.grid_sample(veil, 2 * grid - 1, padding_mode="border", align_corners=False)


def lifted(image: Tensor, veil: Tensor) -> Tensor:
    """Pictures [N, 3, H, W] without their veils [N, 4, H, W]; sRGB-encoded, not clipped above."""
    thickness, light = veil[:, :1], veil[:, 1:]
    return encoded((decoded(image) - thickness * light) / (1 - thickness))


def veil_loss(veil: Tensor, rainy: Tensor, clean: Tensor, truth: Tensor) -> Tensor:
    """How far a veil is from the true one, and how much of whole pictures' coarse errors it leaves.

    The errors count as logarithm of their root mean square, as PSNR takes it. On their own they teach slowly: from
    no veil at all, a little of it in the wrong place is worse than none.

    Args:
        veil: found, [N, 4, h, w].
        rainy: squeezed pictures [N, 3, 128, 128].
        clean: the same, dry.
        truth: V and V w [N, 4, 128, 128]; NaN where nobody knows.
    """
    found = torch.cat([veil[:, :1], veil[:, :1] * veil[:, 1:]], dim=1)
    truth = functional.adaptive_avg_pool2d(truth, (found.shape[-2], found.shape[-1]))
    known = ~truth.isnan()
    away = (found - torch.where(known, truth, found)).abs().sum() / known.sum().clamp_min(1)
    rainy, clean = (functional.avg_pool2d(picture, COARSE) for picture in (rainy, clean))
    fine = functional.interpolate(veil, size=rainy.shape[-2:], mode="bilinear", align_corners=False)
    errors = (lifted(rainy, fine).clamp_max(1) - clean).square().mean((1, 2, 3))
    return TRUTH * away + 0.5 * (errors + FLOOR**2).log().mean()


def decoded(image: Tensor) -> Tensor:
    """Linear light of sRGB-encoded values (IEC 61966-2-1)."""
    return torch.where(image <= 0.04045, image / 12.92, ((image.clamp_min(0.04045) + 0.055) / 1.055) ** 2.4)


def encoded(light: Tensor) -> Tensor:
    """The opposite; what is negative becomes 0."""
    low = light.clamp_min(0) * 12.92
    return torch.where(light <= 0.0031308, low, 1.055 * light.clamp_min(0.0031308) ** (1 / 2.4) - 0.055)
