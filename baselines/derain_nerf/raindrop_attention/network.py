"""The attentive generator (Qian et al. 2018): where the drops on the lens are, and the picture without them.

Where this differs from the paper, all by configuration: `attention_stride` finds the attention in squares of pixels,
and `residual` adds the autoencoder's outputs to the picture. `small` does both; `paper` neither.
"""

import math
from typing import NamedTuple

from torch import Tensor, nn
from torch.nn import functional

from baselines.derain_nerf.raindrop_attention.attention import RecurrentAttention
from baselines.derain_nerf.raindrop_attention.autoencoder import MULTIPLE, ContextualAutoencoder, Frames, frames_of
from baselines.derain_nerf.raindrop_attention.config import GeneratorConfig


class Derained(NamedTuple):
    """What a generator finds."""

    maps: tuple[Tensor, ...]  # attention after each look [N, 1, h, w] in (0, 1), h and w in squares of the stride
    frames: Frames  # without drops; not bounded


class DerainGenerator(nn.Module):
    """Attention, then removal."""

    def __init__(self, config: GeneratorConfig) -> None:
        super().__init__()
        self.config = config
        self.multiple = math.lcm(MULTIPLE, config.attention_stride)
        self.attention = RecurrentAttention(
            config.iterations, config.attention_width, config.attention_blocks, config.attention_stride
        )
        self.autoencoder = ContextualAutoencoder(config.width)
        if config.residual:
            self.autoencoder.quieten()

    def forward(self, picture: Tensor) -> Derained:
        """Of pictures [N, 3, H, W], sRGB-encoded in [0, 1], H and W multiples of `multiple`."""
        maps = self.maps(picture)
        frames = self.autoencoder(_centred(picture), full_size(maps[-1], picture))
        if self.config.residual:
            frames = Frames(*(own + added for own, added in zip(frames_of(picture), frames, strict=True)))
        return Derained(maps, frames)

    def maps(self, picture: Tensor) -> tuple[Tensor, ...]:
        """The attention alone: see `Derained`."""
        return self.attention(_centred(picture))


def _centred(picture: Tensor) -> Tensor:
    """[0, 1] as [-1, 1]."""
    return 2 * picture - 1


def full_size(attention: Tensor, picture: Tensor) -> Tensor:
    """A map brought to the resolution of a picture, bilinear."""
    size = (picture.shape[-2], picture.shape[-1])
    return attention if attention.shape[-2:] == size else functional.interpolate(attention, size, mode="bilinear")
