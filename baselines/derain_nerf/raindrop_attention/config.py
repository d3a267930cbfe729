"""How large the networks are and how they are trained: as data, so that a checkpoint and a data card can say it."""

from dataclasses import dataclass, field
from typing import Literal

from baselines.supervised.config import SupervisedConfig

Perceptual = Literal["alex", "vgg"]


@dataclass(frozen=True)
class GeneratorConfig:
    """Attention and autoencoder; the defaults are those of Qian et al. 2018 and its public re-implementation."""

    iterations: int = 4  # N of the recurrent attention
    attention_width: int = 32  # channels of residual blocks and LSTM
    attention_blocks: int = 5
    attention_stride: int = 1  # attention is found in squares of so many pixels along a side
    width: int = 64  # channels of the autoencoder at full resolution; doubled at a half, and again at a fourth
    residual: bool = False  # the autoencoder gives what is added to the picture, instead of the picture


@dataclass(frozen=True)
class DiscriminatorConfig:
    """Real or derained: a network that looks most where the attention is."""

    stride: int = 1  # pictures are taken in squares of so many pixels along a side
    widths: tuple[int, ...] = (8, 16, 32, 64, 128, 128)  # channels of the convolutions before the map
    reduced: tuple[int, ...] = (64, 32)  # and of those after it, each a fourth of the size
    pooled: int = 14  # what is left is brought to so many squares a side: no change for patches of 224 pixels
    hidden: int = 1024


@dataclass(frozen=True)
class LossConfig:
    """Weights of the losses, those of Qian et al. 2018."""

    perceptual: Perceptual = "vgg"
    perceptual_weight: float = 1.0
    adversarial: float = 0.01


@dataclass(frozen=True, kw_only=True)
class TrainingConfig(SupervisedConfig):
    """Both networks, their losses, and how pictures are used."""

    generator: GeneratorConfig = field(default_factory=GeneratorConfig)
    discriminator: DiscriminatorConfig = field(default_factory=DiscriminatorConfig)
    losses: LossConfig = field(default_factory=LossConfig)
    crops: int = 1  # patches cut from one drawn picture
    removal_every: int = 1  # steps; in those between the attention alone learns, which is cheaper


SMALL_GENERATOR = GeneratorConfig(attention_width=32, attention_blocks=3, attention_stride=2, width=24, residual=True)
CONFIGS = {
    "paper": TrainingConfig(steps=100_000, patch=224, rate=2e-4, warm_up=100),
    "small": TrainingConfig(
        generator=SMALL_GENERATOR,
        discriminator=DiscriminatorConfig(stride=4, widths=(16, 32, 32), reduced=(32, 16), pooled=2, hidden=64),
        losses=LossConfig(perceptual="alex", perceptual_weight=0.05),
        steps=2_500,
        patch=128,
        crops=2,
        batch=2,
        removal_every=4,
        rate=2e-3,
        warm_up=100,
        averaging=0.998,
        precision="bfloat16",
    ),
}
