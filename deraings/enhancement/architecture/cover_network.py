"""The part of the enhancement network that predicts what streaks, drops and mist cover.

A published drop is one or two pixels wide. So this part works at the picture's own resolution; the rest of a small
network works at half of it. It is a U-Net (Ronneberger et al. 2015) of dense 3x3 convolutions with residual
blocks. It is given the picture beside a copy of which every neighbourhood has the same mean and contrast: under thick
mist a drop differs from its neighbours by little.
"""

from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn import functional

from deraings.enhancement.architecture.lens_statistics import FINE
from deraings.enhancement.architecture.mist_branch import added, known

NEIGHBOURHOOD = 25  # pixels along a side
LEAST_CONTRAST = 1e-3  # mean square of a neighbourhood's differences, added before they are divided by it


class CoverNetwork(nn.Module):
    """Pictures in, the logits of their cover out."""

    def __init__(self, widths: Sequence[int], lens_fine: bool) -> None:
        """Of so many channels at the picture's resolution, a half of it, and so on.

        Args:
            widths: at least two.
            lens_fine: whether statistics of the lens are looked at as well.
        """
        super().__init__()
        self.stem = nn.Conv2d(6, widths[0], 3, padding=1)
        self.encoder = nn.ModuleList(DenseBlock(width, width) for width in widths)
        self.down = nn.ModuleList(nn.Conv2d(fine, coarse, 2, stride=2) for fine, coarse in pairwise(widths))
        self.up = nn.ModuleList(nn.ConvTranspose2d(coarse, fine, 2, stride=2) for fine, coarse in pairwise(widths))
        self.decoder = nn.ModuleList(DenseBlock(2 * width, width) for width in widths[:-1])
        self.head = nn.Conv2d(widths[0], 3, 3, padding=1)
        self.lens_fine = added(FINE, widths[1], 3) if lens_fine else None

    @property
    def multiple(self) -> int:
        """Height and width have to be multiples of this number of pixels."""
        return int(2 ** len(self.down))

    def forward(self, image: Tensor, fine: Tensor | None = None) -> Tensor:
        """The cover by streaks, drops and mist.

        Args:
            image: [N, 3, H, W], sRGB-encoded, [0, 1].
            fine: statistics of the lenses [N, FINE, H / 2, W / 2]; they do not count where they are zeros.

        Returns:
            Logits [N, 3, H, W].
        """
        both = torch.cat([image - 0.5, locally_normalised(image)], dim=1)
        x = functional.relu(self.stem(both.contiguous(memory_format=torch.channels_last)))
        skips: list[Tensor] = []
        for level, (block, down) in enumerate(zip(self.encoder[:-1], self.down, strict=True)):
            skips.append(block(x))
            x = down(skips[-1])
            if level == 0 and fine is not None and self.lens_fine is not None:
                x = x + known(fine) * self.lens_fine(fine.contiguous(memory_format=torch.channels_last))
        x = self.encoder[-1](x)
        for level in reversed(range(len(self.up))):
            x = self.decoder[level](torch.cat([self.up[level](x), skips[level]], dim=1))
        logits: Tensor = self.head(x)
        return logits


class DenseBlock(nn.Module):
    """Two 3x3 convolutions beside a shortcut (He et al. 2016)."""

    def __init__(self, given: int, width: int) -> None:
        super().__init__()
        self.first = nn.Conv2d(given, width, 3, padding=1)
        self.second = nn.Conv2d(width, width, 3, padding=1)
        self.shortcut = nn.Identity() if given == width else nn.Conv2d(given, width, 1)

    def forward(self, x: Tensor) -> Tensor:
        """[N, given, H, W] to [N, width, H, W]."""
        return functional.relu(self.shortcut(x) + self.second(functional.relu(self.first(x))))


def locally_normalised(image: Tensor) -> Tensor:
    """Pictures [N, 3, H, W] less the means of neighbourhoods, over the contrast of these; the same shape."""
    mean = neighbourhood_mean(image)
    contrast = (neighbourhood_mean(image * image) - mean * mean).clamp_min(0).mean(dim=1, keepdim=True)
    return (image - mean) / (contrast + LEAST_CONTRAST).sqrt()


def neighbourhood_mean(image: Tensor) -> Tensor:
    """Means of the squares around the pixels of [N, C, H, W], as far as the squares lie in the picture."""
    rows = functional.avg_pool2d(image, (NEIGHBOURHOOD, 1), 1, (NEIGHBOURHOOD // 2, 0), count_include_pad=False)
    return functional.avg_pool2d(rows, (1, NEIGHBOURHOOD), 1, (0, NEIGHBOURHOOD // 2), count_include_pad=False)
