"""The network that predicts occlusion masks: encoder, spectral pooling, channel attention, U-Net (DeRainGS, fig. 2).

Features are [N, C, h, w] at the mask's resolution, which is `shrink` times lower than the picture's: blocks of
shrink x shrink pixels become channels, so that streaks thinner than a block are still seen.
"""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import cast

import torch
from torch import Tensor, nn
from torch.nn import functional

SHRINK = 4  # the network works at this fraction of the picture's resolution
FINE = 2  # mask pixels a side for each pixel of the network
WIDTH = 16  # channels of the encoder: a step takes 16 ms at 320x240, more than half as long again with 24
CUTOFF = 0.125  # of the high-pass filter, in cycles a pixel of the network's resolution
LEVELS = 5  # resolutions of the U-Net
SMALLEST = 2**LEVELS  # pixels a side: batch statistics need more than one value at the coarsest level
FIRST_MASK = 0.02  # what an untrained network predicts about everywhere


def masked_loss(mask: Tensor, loss: Tensor, regulariser: float, penalty: float = 0.0) -> Tensor:
    """mean((1 - M) l) + lambda_reg mean(M^2) + penalty mean(M), for the network to make small.

    Least where M = (l - penalty) / (2 lambda_reg), clipped to [0, 1]. The paper has no penalty, and sums M^2; as a mean
    lambda_reg does not depend on the number of pixels.

    Args:
        mask: M, in [0, 1].
        loss: l, what each pixel adds to the photometric loss, of the same shape.
        regulariser: lambda_reg.
        penalty: a loss that is not worth masking.
    """
    return ((1 - mask) * loss + regulariser * mask**2 + penalty * mask).mean()


def high_pass(height: int, width: int, cutoff: float) -> Tensor:
    """T of the paper: 0 below `cutoff` cycles a pixel of the feature map, in any direction, else 1.

    Returns:
        [height, width // 2 + 1], the frequencies of `torch.fft.rfft2`; the constant is always removed.
    """
    rows, columns = torch.fft.fftfreq(height)[:, None], torch.fft.rfftfreq(width)[None]
    radius = torch.sqrt(rows**2 + columns**2)
    return ((radius >= cutoff) & (radius > 0)).float()


def spectral_pooling(features: Tensor, cutoff: float) -> Tensor:
    """How strong each channel's high frequencies are: the root mean square [N, C] of the high-passed map.

    The mean of a high-passed map is zero, as its constant is removed, and would tell the attention nothing. By
    Parseval's theorem the root mean square follows from the spectrum, without transforming back.

    Args:
        features: [N, C, h, w].
        cutoff: see `high_pass`.
    """
    height, width = features.shape[-2:]
    spectrum = torch.fft.rfft2(features, norm="forward") * high_pass(height, width, cutoff).to(features)
    twice = torch.full((width // 2 + 1,), 2.0).to(features)  # rfft2 leaves out the mirrored half
    twice[0] = 1
    if width % 2 == 0:
        twice[-1] = 1
    power = (spectrum.real**2 + spectrum.imag**2) * twice
    return torch.sqrt(power.sum(dim=(2, 3)) + 1e-12)


class ChannelAttention(nn.Module):
    """Channels weighed by their high frequencies: A = sigmoid(MLP(pooled)), F' = A F."""

    def __init__(self, channels: int, cutoff: float) -> None:
        super().__init__()
        self.cutoff = cutoff
        self.mlp = nn.Sequential(nn.Linear(channels, channels), nn.ReLU(), nn.Linear(channels, channels))

    def forward(self, features: Tensor) -> Tensor:
        """[N, C, h, w] to the same."""
        scores = torch.sigmoid(self.mlp(spectral_pooling(features, self.cutoff)))
        return features * scores[:, :, None, None]


def convolution(inputs: int, outputs: int, kernel: int, active: bool = True) -> nn.Sequential:
    """Convolution and batch normalisation, and where `active` a rectifier."""
    layers: list[nn.Module] = [
        nn.Conv2d(inputs, outputs, kernel, padding=kernel // 2, bias=False),
        nn.BatchNorm2d(outputs),
    ]
    return nn.Sequential(*layers, *([nn.ReLU()] if active else []))


class UNet(nn.Module):
    """Five resolutions with skips, one convolution a level on the way down and one on the way up."""

    def __init__(self, widths: Sequence[int], outputs: int) -> None:
        super().__init__()
        self.down = nn.ModuleList(convolution(a, b, 3) for a, b in pairwise((widths[0], *widths)))
        upwards = pairwise(reversed(widths))
        self.up = nn.ModuleList(convolution(deep + shallow, shallow, 3) for deep, shallow in upwards)
        self.head = nn.Conv2d(widths[0], outputs, 1)
        with torch.no_grad():
            self.head.weight.zero_()
            cast(Tensor, self.head.bias).fill_(math.log(FIRST_MASK / (1 - FIRST_MASK)))

    def forward(self, x: Tensor) -> Tensor:
        """[N, widths[0], h, w] to [N, outputs, h, w]."""
        skips = []
        for level, block in enumerate(self.down):
            x = block(functional.max_pool2d(x, 2, ceil_mode=True) if level else x)
            skips.append(x)
        for block, skip in zip(self.up, reversed(skips[:-1]), strict=True):
            x = functional.interpolate(x, size=skip.shape[-2:], mode="bilinear", align_corners=False)
            x = block(torch.cat([x, skip], dim=1))
        return self.head(x)


class MaskNetwork(nn.Module):
    """Predicts M [N, 1, H, W] in (0, 1) from pictures [N, 3, H, W] in [0, 1]."""

    def __init__(
        self, shrink: int, fine: int, width: int, cutoff: float, extra: int = 0, attention: bool = True
    ) -> None:
        super().__init__()
        self.shrink, self.fine = shrink, fine
        widths = tuple(round(width * factor) for factor in (1, 1.5, 2, 3, 4))
        self.encoder = nn.Sequential(
            convolution(3 * shrink**2 + extra, width, 1),
            convolution(width, width, 3),
            convolution(width, width, 1, active=False),
        )
        self.attention = ChannelAttention(width, cutoff) if attention else nn.Identity()
        self.unet = UNet(widths, fine**2)

    def forward(self, pictures: Tensor, extra: Tensor | None = None) -> Tensor:
        """M at `fine` / `shrink` of the pictures' size, which must be multiples of `shrink`."""
        x = functional.pixel_unshuffle(pictures - 0.5, self.shrink)
        if extra is not None:
            x = torch.cat([x, extra], dim=1)
        height, width = x.shape[-2:]
        missing = (0, max(0, SMALLEST - width), 0, max(0, SMALLEST - height))
        if any(missing):
            x = functional.pad(x, missing, mode="replicate")
        logits = self.unet(self.attention(self.encoder(x)))[..., :height, :width]
        return torch.sigmoid(functional.pixel_shuffle(logits, self.fine))
