"""The enhancement network of DeRainGS: local features, global features, global refinement, at five levels.

A small branch takes mist off the whole picture first, where the configuration asks for it: `mist_branch.py`. Both it
and the rest may also look at what all photographs of a lens say of its places: `lens_statistics.py`. Then an encoder
of convolutional blocks, a bottleneck of attention across channels, and a decoder of the same attention kept to its
strongest entries (DeRainGS, section Rainy Image Enhancement and its pipeline figure). A detector of what rain covers
stands before the encoder, which is given its prediction, where the configuration asks for it: `cover_network.py`.
Level i has width 2^i channels
at 1 / (stem 2^i) of the picture's resolution. Read from top to bottom: configuration, blocks, network.

Tensors are [N, C, H, W] in channels-last memory, so that layer normalisation and 1x1 convolutions touch contiguous
numbers.
"""

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple, cast

import torch
from torch import Tensor, nn
from torch.nn import functional

from deraings.enhancement.architecture.cover_network import CoverNetwork
from deraings.enhancement.architecture.lens_statistics import COARSE, FINE
from deraings.enhancement.architecture.mist_branch import MistBranch, added, known, without_mist_over_whole

LEVELS = 5
KEPT = (1 / 2, 2 / 3, 3 / 4, 4 / 5)  # shares of its entries that a row of sparse attention keeps (Chen et al. 2023)
KEPT_WEIGHT = 0.2  # of each share, to begin with
SHORTEST = 1e-6  # length of a query or key that scores are divided by
ERROR = 0.03  # mean absolute error, encoded, that an untrained network predicts of itself
SQUEEZE = 4  # channels in a channel attention's middle layer: a fourth


@dataclass(frozen=True)
class NetworkConfig:
    """Width and depth; the defaults are the paper's depths, at the width of its references."""

    width: int = 48  # channels of the finest level; each coarser one has twice as many
    encoder: tuple[int, int, int, int] = (4, 6, 7, 8)  # local blocks a level, finest first
    bottleneck: int = 8  # attention blocks at the coarsest level
    decoder: tuple[int, int, int, int] = (3, 6, 7, 8)  # sparse attention blocks a level, finest first
    head_width: int = 48  # channels of an attention head
    stem: int = 1  # the picture is taken in squares of so many pixels: 2 makes every level four times smaller
    cover: tuple[int, ...] = ()  # channels of the levels of the cover network, finest first; none: there is none
    error: bool = False  # also predict the scale of its own error
    gain: bool = False  # predict I' = I + g I + r instead of I' = I + r, g and r from the network
    mist: int = 0  # channels of the branch that takes mist off the whole picture first; 0: there is none
    lens_mist: bool = False  # a second such branch, for pictures of which it is known what others of their lens show
    lens_fine: bool = False  # the rest looks at that as well, in squares of 2x2 pixels; wants a stem of 2

    @property
    def lens(self) -> bool:
        """Whether anything looks at what photographs of one lens have in common."""
        return self.lens_mist or self.lens_fine


PAPER = NetworkConfig()
SMALL = NetworkConfig(
    width=24,
    encoder=(1, 2, 3, 3),
    bottleneck=2,
    decoder=(1, 2, 2, 2),
    head_width=24,
    stem=2,
    cover=(16, 32, 64, 96),
    error=True,
    gain=True,
    mist=48,
    lens_mist=True,
    lens_fine=True,
)
CONFIGS = {"paper": PAPER, "small": SMALL}


class Prediction(NamedTuple):
    """All that a network predicts of pictures or parts of pictures."""

    picture: Tensor  # [N, 3, H, W], not clipped
    cover: Tensor | None  # what of each pixel streaks, drops and mist block, [N, 3, H, W] in [0, 1]
    error: Tensor | None  # mean absolute error of the picture that is to be expected, [N, 1, H, W], positive


class ChannelNorm(nn.Module):
    """Layer normalisation over the channels of each pixel (Ba et al. 2016)."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.norm = nn.LayerNorm(channels)

    def forward(self, x: Tensor) -> Tensor:
        """[N, C, H, W] to the same."""
        normed: Tensor = self.norm(x.permute(0, 2, 3, 1))
        return normed.permute(0, 3, 1, 2)


class ChannelAttention(nn.Module):
    """Channels weighed by what the whole picture has of them (Hu et al. 2018)."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.squeeze = nn.Conv2d(channels, channels // SQUEEZE, 1)
        self.excite = nn.Conv2d(channels // SQUEEZE, channels, 1)

    def forward(self, x: Tensor) -> Tensor:
        """[N, C, H, W] to the same."""
        pooled = x.mean(dim=(2, 3), keepdim=True)
        return x * torch.sigmoid(self.excite(functional.relu(self.squeeze(pooled))))


class LocalBlock(nn.Module):
    """Local feature extraction: twice the channels, depthwise convolutions, channel attention, back; residual."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        wide = 2 * channels
        self.body = nn.Sequential(
            nn.Conv2d(channels, wide, 1),
            nn.Conv2d(wide, wide, 3, padding=1, groups=wide),
            ChannelNorm(wide),
            nn.GELU(),
            nn.Conv2d(wide, wide, 3, padding=1, groups=wide),
            ChannelAttention(wide),
            nn.Conv2d(wide, channels, 1),
        )

    def forward(self, x: Tensor) -> Tensor:
        """[N, C, H, W] to the same."""
        result: Tensor = x + self.body(x)
        return result


class TransposedAttention(nn.Module):
    """Attention between channels instead of pixels (Zamir et al. 2022), so that its cost is linear in the pixels."""

    def __init__(self, channels: int, heads: int) -> None:
        super().__init__()
        self.heads = heads
        self.norm = ChannelNorm(channels)
        self.project = nn.Conv2d(channels, 3 * channels, 1)
        self.gather = nn.Conv2d(3 * channels, 3 * channels, 3, padding=1, groups=3 * channels)
        self.scale = nn.Parameter(torch.ones(heads, 1, 1))
        self.output = nn.Conv2d(channels, channels, 1)

    def forward(self, x: Tensor) -> Tensor:
        """[N, C, H, W] to the same."""
        n, channels, height, width = x.shape
        mixed = self.gather(self.project(self.norm(x))).permute(0, 2, 3, 1).reshape(n, height * width, 3 * channels)
        query, key, value = (part.unflatten(-1, (self.heads, -1)) for part in mixed.chunk(3, dim=-1))
        scores = precise(torch.einsum("nphc,nphd->nhcd", query, key))
        lengths = torch.einsum("nhc,nhd->nhcd", length(query), length(key))  # cheaper than normalising every pixel
        attention = self.weights(self.scale * scores / lengths)
        attended = torch.einsum("nhcd,nphd->nphc", attention.to(value.dtype), value)
        attended = attended.reshape(n, height, width, channels).permute(0, 3, 1, 2)
        result: Tensor = x + self.output(attended)
        return result

    def weights(self, scores: Tensor) -> Tensor:
        """Attention [N, heads, C, C], rows of sum 1, of scores of the same shape."""
        return scores.softmax(dim=-1)


def length(part: Tensor) -> Tensor:
    """Euclidean length over the pixels of queries or keys [N, P, heads, C]: [N, heads, C]."""
    return precise(torch.linalg.vector_norm(part, dim=1)).clamp_min(SHORTEST)


def precise(x: Tensor) -> Tensor:
    """At least float32, whatever convolutions are computed in."""
    return x.to(torch.promote_types(x.dtype, torch.float32))


class SparseAttention(TransposedAttention):
    """Attention between channels of which each row keeps its largest entries, for several shares of them (DRSformer).

    The softmax is over what is kept; the shares' results are added with learned weights.
    """

    def __init__(self, channels: int, heads: int) -> None:
        super().__init__(channels, heads)
        self.kept = nn.Parameter(torch.full((len(KEPT),), KEPT_WEIGHT))

    def weights(self, scores: Tensor) -> Tensor:
        """See TransposedAttention; rows sum to the sum of the learned weights."""
        size = scores.shape[-1]
        ordered = scores.detach().sort(dim=-1, descending=True).values
        total = torch.zeros_like(scores)
        for weight, share in zip(self.kept, KEPT, strict=True):
            least = ordered[..., max(1, int(size * share)) - 1, None]
            total = total + weight * scores.masked_fill(scores < least, float("-inf")).softmax(dim=-1)
        return total


def stack(count: int, block: type[nn.Module], *arguments: int) -> nn.Sequential:
    """So many blocks, one after another."""
    return nn.Sequential(*(block(*arguments) for _ in range(count)))


def initialise(module: nn.Module) -> None:
    """Convolutions that keep the variance of what they are given, so that coarse levels count from the start."""
    if isinstance(module, nn.Conv2d):
        nn.init.kaiming_normal_(module.weight, nonlinearity="linear")
        nn.init.zeros_(cast(Tensor, module.bias))
        module.weight.data = module.weight.data.contiguous(memory_format=torch.channels_last)


class EnhancementNetwork(nn.Module):
    """Rainy picture in, enhanced picture out."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.config = config
        widths = [config.width * 2**level for level in range(LEVELS)]
        heads = [max(1, width // config.head_width) for width in widths]
        taken, given = 3 * config.stem**2, (6 if config.gain else 3) * config.stem**2
        self.stem = nn.Sequential(nn.PixelUnshuffle(config.stem), nn.Conv2d(taken, widths[0], 3, padding=1))
        self.encoder, self.down, self.up, self.skip, self.decoder = (nn.ModuleList() for _ in range(5))
        for level, (fine, coarse) in enumerate(pairwise(widths)):
            self.encoder.append(stack(config.encoder[level], LocalBlock, fine))
            self.down.append(nn.Conv2d(fine, coarse, 2, stride=2))
            self.up.append(nn.Sequential(nn.Conv2d(coarse, 4 * fine, 1), nn.PixelShuffle(2)))
            self.skip.append(nn.Conv2d(2 * fine, fine, 1))
            self.decoder.append(stack(config.decoder[level], SparseAttention, fine, heads[level]))
        self.bottleneck = stack(config.bottleneck, TransposedAttention, widths[-1], heads[-1])
        self.head = nn.Sequential(nn.Conv2d(widths[0], given, 3, padding=1), nn.PixelShuffle(config.stem))
        if config.cover:
            self.cover = CoverNetwork(config.cover, config.lens_fine)
            self.covered = nn.Sequential(nn.PixelUnshuffle(config.stem), *added(taken, widths[0], 3))
            self.alpha = nn.Sequential(nn.Conv2d(widths[0], taken, 3, padding=1), nn.PixelShuffle(config.stem))
        if config.error:
            self.error = nn.Sequential(nn.Conv2d(widths[0], config.stem**2, 3, padding=1), nn.PixelShuffle(config.stem))
        if config.mist:
            self.mist = MistBranch(config.mist)
        if config.mist and config.lens_mist:
            self.lens_mist = MistBranch(config.mist, COARSE)
        if config.lens_fine:
            self.lens_fine = added(FINE, widths[0], 3)
        self.apply(initialise)
        self._start_as_identity()

    def _start_as_identity(self) -> None:
        """An untrained network changes nothing; nor do statistics, where it has not learned with them."""
        last = [self.head[0]]
        if self.config.error:
            last.append(self.error[0])
        if self.config.mist:
            last.append(self.mist.end)
        if self.config.cover:
            last += [self.covered[-1], self.alpha[0]]
        if self.config.lens_fine:
            last.append(self.lens_fine[-1])
        if self.config.cover and self.config.lens_fine:
            last.append(cast(nn.Sequential, self.cover.lens_fine)[-1])
        if self.config.mist and self.config.lens_mist:
            last += [self.lens_mist.end, self.lens_mist.shared[-1]]
        for convolution in last:
            nn.init.zeros_(cast(nn.Conv2d, convolution).weight)
        if self.config.error:
            nn.init.constant_(cast(Tensor, self.error[0].bias), math.log(ERROR))

    @property
    def device(self) -> torch.device:
        """Where it calculates."""
        return next(self.parameters()).device

    @property
    def multiple(self) -> int:
        """What height and width have to be multiples of."""
        return math.lcm(self.config.stem * 2 ** (LEVELS - 1), self.cover.multiple if self.config.cover else 1)

    def forward(self, image: Tensor, coarse: Tensor | None = None, fine: Tensor | None = None) -> Tensor:
        """Enhance whole pictures.

        Args:
            image: [N, 3, H, W], sRGB-encoded, [0, 1].
            coarse: statistics of their lenses [N, COARSE, 16, 16]; they do not count where they are zeros.
            fine: the same [N, FINE, H / 2, W / 2].

        Returns:
            The same shape as `image`, not clipped.
        """
        return self.refine(self.remove_mist(image, coarse), fine)

    def remove_mist(self, image: Tensor, coarse: Tensor | None = None) -> Tensor:
        """Whole pictures without the mist over them, if the network looks for it."""
        if not self.config.mist:
            return image
        return without_mist_over_whole(image, self.find_mist(image, coarse))

    def find_mist(self, image: Tensor, coarse: Tensor | None = None) -> Tensor:
        """The mist over whole pictures [N, 4, 16, 16], by the second branch where there are statistics of the lens."""
        alone: Tensor = self.mist(image)
        if coarse is None or not self.config.lens_mist:
            return alone
        return torch.where(known(coarse) > 0, self.lens_mist(image, coarse), alone)

    def refine(self, image: Tensor, fine: Tensor | None = None) -> Tensor:
        """The rest, for pictures or parts of pictures that are free of mist."""
        return self.predict(image, fine).picture

    def predict(self, image: Tensor, fine: Tensor | None = None) -> Prediction:
        """The same, with all else that the network predicts of each pixel."""
        first = self.first_cover(image, fine)
        features = self.features(image, fine, first)
        cover = None if first is None else torch.sigmoid(self.second_cover(first, features))
        return Prediction(self.enhanced(image, features), cover, self.error_scale(features))

    def first_cover(self, image: Tensor, fine: Tensor | None = None) -> Tensor | None:
        """Logits [N, 3, H, W] of what streaks, drops and mist cover, by the cover network; None where there is none."""
        # The mist is not to be altered for the sake of the cover.
        return self.cover(image.detach(), fine).float() if self.config.cover else None

    def second_cover(self, first: Tensor, features: Tensor) -> Tensor:
        """The same with what the decoder adds: it sees further, which tells large drops from things in the scene."""
        return first + self.alpha(features).float()

    def error_scale(self, features: Tensor) -> Tensor | None:
        """The scale [N, 1, H, W] of the error of the picture that features lead to; None where it is not predicted."""
        return self.error(features).float().exp() if self.config.error else None

    def features(self, image: Tensor, fine: Tensor | None = None, first_cover: Tensor | None = None) -> Tensor:
        """The last features of the decoder, [N, width, H / stem, W / stem]; no gradient goes back to `first_cover`."""
        x = self.stem(image.contiguous(memory_format=torch.channels_last))
        if first_cover is not None:
            x = x + self.covered(torch.sigmoid(first_cover.detach()).contiguous(memory_format=torch.channels_last))
        if fine is not None and self.config.lens_fine:
            x = x + known(fine) * self.lens_fine(fine.contiguous(memory_format=torch.channels_last))
        skips = []
        for blocks, down in zip(self.encoder, self.down, strict=True):
            x = blocks(x)
            skips.append(x)
            x = down(x)
        x = self.bottleneck(x)
        for level in reversed(range(LEVELS - 1)):
            x = torch.cat([self.up[level](x), skips[level]], dim=1)
            x = self.decoder[level](self.skip[level](x))
        return x

    def enhanced(self, image: Tensor, features: Tensor) -> Tensor:
        """The picture that features lead to."""
        predicted = self.head(features).to(image.dtype)
        if not self.config.gain:
            return image + predicted
        gain, rest = predicted.chunk(2, dim=1)
        return image + gain * image + rest
