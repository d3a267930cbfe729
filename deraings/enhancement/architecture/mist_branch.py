"""The network's branch for mist: on the lens, and the haze of rain too dense to be seen singly.

It looks at the whole picture, however large, squeezed to 128x128 pixels, and predicts which share of each place's light
the mist blocks (mist_alpha), and the mist's own light w. Where mist is thick follows from what a picture lacks, such as
dark and saturated places, and from where it lacks them; a network that sees parts of pictures does not learn that. The
mist is then taken off by inverting I = (1 - mist_alpha) B + mist_alpha w in linear light, which costs the following
network nothing.

"Mist" below is a tensor of 4 channels: mist_alpha and w.
"""

import torch
from torch import Tensor, nn
from torch.nn import functional

SIDE, CELL = 128, 8  # pixels of the squeezed picture, and of a cell whose statistics the network sees
FINE = 2  # pixels; smallest values are also averaged over parts of a cell, which a dark speck does not change
CELLS = SIDE // CELL
STATISTICS = 20  # 6 of each channel, and the place
LAYERS = 5
MAX_ALPHA = 0.97  # what is behind thicker mist is lost
COARSE = 4  # pixels of the squeezed picture that the loss averages over
TRUE_MIST = 10.0  # weight of the distance to the true mist
SHORTAGE = 1e-4  # mist_alpha below which all mists say as much of their light
FLOOR = 0.02  # encoded; smaller errors hardly count

Box = tuple[float, float, float, float]  # top, bottom, left, right of a part, in shares of the picture's sides


class MistBranch(nn.Module):
    """Statistics of a picture's cells in, mist out: residual layers that all know the whole."""

    def __init__(self, width: int, shared: int = 0) -> None:
        """Of so many channels, for pictures that come with `shared` channels of lens_statistics, if any."""
        super().__init__()
        self.start = nn.Conv2d(STATISTICS, width, 1)
        if shared:
            self.shared = added(shared, width, 1)
        self.near = nn.ModuleList(nn.Conv2d(2 * width, width, 3, padding=1) for _ in range(LAYERS))
        self.far = nn.ModuleList(nn.Linear(3 * width, width) for _ in range(LAYERS))
        self.end = nn.Conv2d(width, 4, 1)

    def forward(self, image: Tensor, shared: Tensor | None = None) -> Tensor:
        """The mist of pictures.

        Args:
            image: [N, 3, H, W], sRGB-encoded.
            shared: what the photographs of their lenses share, [N, shared, 16, 16].

        Returns:
            [N, 4, 16, 16], mist_alpha in (-0.97, 0.97) and w, linear, in (0, 1).
        """
        x = self.start(statistics(squeezed(image)))
        if shared is not None:
            x = x + self.shared(shared)
        x = functional.relu(x)
        for near, far in zip(self.near, self.far, strict=True):
            whole = far(torch.cat([x.mean((2, 3)), x.amax((2, 3)), x.amin((2, 3))], dim=1))
            x = x + functional.relu(near(torch.cat([x, whole[:, :, None, None].expand_as(x)], dim=1)))
        found = self.end(x)
        light = torch.sigmoid(found[:, 1:].mean((2, 3), keepdim=True)).expand(-1, -1, *found.shape[2:])
        return torch.cat([MAX_ALPHA * torch.tanh(found[:, :1]), light], dim=1)


def squeezed(image: Tensor) -> Tensor:
    """Pictures [N, 3, H, W] of any size at 128x128, averaged over areas."""
    return image if image.shape[-2:] == (SIDE, SIDE) else functional.adaptive_avg_pool2d(image, SIDE)


def added(given: int, width: int, side: int) -> nn.Sequential:
    """Layers for an input that need not be there: [N, given, H, W] to [N, width, H, W]; untrained they add nothing."""
    return nn.Sequential(nn.Conv2d(given, width, side, padding=side // 2), nn.ReLU(), nn.Conv2d(width, width, 1))


def known(shared: Tensor) -> Tensor:
    """Where statistics [N, C, H, W] are of any photographs, 0 or 1: [N, 1, 1, 1]."""
    return (shared[:, -1:, :1, :1] > 0).to(shared.dtype)


def statistics(image: Tensor) -> Tensor:
    """Statistics of the cells of squeezed pictures, and where they are: [N, 20, 16, 16]."""
    cells = cell_statistics(image)
    side = torch.linspace(-0.5, 0.5, cells.shape[-1], dtype=image.dtype, device=image.device)
    place = torch.stack(torch.meshgrid(side, side, indexing="ij")).expand(len(image), -1, -1, -1)
    return torch.cat([cells, place], dim=1)


def cell_statistics(image: Tensor) -> Tensor:
    """Mean, spread, extremes and texture of the cells of squeezed pictures: [N, 18, 16, 16]."""
    mean = functional.avg_pool2d(image, CELL)
    spread = (functional.avg_pool2d(image * image, CELL) - mean * mean).clamp_min(1e-8).sqrt()
    low = functional.avg_pool2d(-highest_of(-image, FINE), CELL // FINE)
    highest, lowest = highest_of(image, CELL), -highest_of(-image, CELL)
    steps = functional.pad((image[..., 1:] - image[..., :-1]).abs(), (0, 1))
    texture = functional.avg_pool2d(steps, CELL)
    return torch.cat([mean, 3 * spread, highest, lowest, low, 5 * texture], dim=1)


def highest_of(image: Tensor, side: int) -> Tensor:
    """The highest values of squares: [N, C, H / side, W / side]; six times faster than torch's pooling."""
    return image.unflatten(2, (-1, side)).amax(3).unflatten(3, (-1, side)).amax(4)


def crop_mist(mist: Tensor, boxes: Tensor, height: int, width: int) -> Tensor:
    """The mist [N, 4, h, w] of parts of pictures, between the cells' middles linear: [N, 4, height, width].

    Args:
        mist: of whole pictures.
        boxes: [N, 4], see `Box`.
        height: pixels of the parts.
        width: the same.
    """
    top, bottom, left, right = (boxes[:, i, None] for i in range(4))
    y = top + (bottom - top) * (torch.arange(height, device=mist.device) + 0.5) / height
    x = left + (right - left) * (torch.arange(width, device=mist.device) + 0.5) / width
    grid = torch.stack([x[:, None, :].expand(-1, height, -1), y[:, :, None].expand(-1, -1, width)], dim=-1)
    return functional.grid_sample(mist, 2 * grid - 1, padding_mode="border", align_corners=False)


def mean_mist(mists: Tensor) -> Tensor:
    """The mean of mists [K, 4, h, w]: [4, h, w]; thick ones say more of the mist's light than thin ones."""
    alpha, light = mists[:, :1], mists[:, 1:]
    weight = alpha.abs() + SHORTAGE
    return torch.cat([alpha.mean(0), (weight * light).sum(0) / weight.sum(0)])


def without_mist(image: Tensor, mist: Tensor) -> Tensor:
    """Pictures [N, 3, H, W] without their mist [N, 4, H, W]; sRGB-encoded, not clipped above."""
    alpha, light = mist[:, :1], mist[:, 1:]
    return encoded((decoded(image) - alpha * light) / (1 - alpha))


def without_mist_over_whole(image: Tensor, mist: Tensor) -> Tensor:
    """Whole pictures [N, 3, H, W] without their mist [N, 4, h, w]; sRGB-encoded, not clipped above."""
    whole = torch.tensor([[0.0, 1.0, 0.0, 1.0]], device=image.device).expand(len(image), -1)
    return without_mist(image, crop_mist(mist, whole, image.shape[-2], image.shape[-1]))


def mist_loss(mist: Tensor, rainy: Tensor, clean: Tensor, true: Tensor) -> Tensor:
    """How far mist is from the true mist, and how much of whole pictures' coarse errors it leaves.

    The errors count as logarithm of their root mean square, as PSNR takes it. On their own they teach slowly: from
    no mist at all, a little of it in the wrong place is worse than none.

    Args:
        mist: predicted, [N, 4, h, w].
        rainy: squeezed pictures [N, 3, 128, 128].
        clean: the same, dry.
        true: mist_alpha and mist_alpha w [N, 4, 128, 128]; NaN where it is not known.
    """
    predicted = torch.cat([mist[:, :1], mist[:, :1] * mist[:, 1:]], dim=1)
    true = functional.adaptive_avg_pool2d(true, (predicted.shape[-2], predicted.shape[-1]))
    known = ~true.isnan()
    away = (predicted - torch.where(known, true, predicted)).abs().sum() / known.sum().clamp_min(1)
    rainy, clean = (functional.avg_pool2d(picture, COARSE) for picture in (rainy, clean))
    fine = functional.interpolate(mist, size=rainy.shape[-2:], mode="bilinear", align_corners=False)
    errors = (without_mist(rainy, fine).clamp_max(1) - clean).square().mean((1, 2, 3))
    return TRUE_MIST * away + 0.5 * (errors + FLOOR**2).log().mean()


def decoded(image: Tensor) -> Tensor:
    """Linear light of sRGB-encoded values, as `hydroviews.scene.images.to_linear`, but with gradients."""
    return torch.where(image <= 0.04045, image / 12.92, ((image.clamp_min(0.04045) + 0.055) / 1.055) ** 2.4)


def encoded(light: Tensor) -> Tensor:
    """sRGB-encoded values of linear light, with gradients; what is negative becomes 0."""
    low = light.clamp_min(0) * 12.92
    return torch.where(light <= 0.0031308, low, 1.055 * light.clamp_min(0.0031308) ** (1 / 2.4) - 0.055)
