"""Is a picture a dry one, or one from which drops were removed? Judged most where drops were (Qian et al. 2018)."""

from itertools import pairwise
from typing import NamedTuple

from torch import Tensor, nn
from torch.nn import functional

from baselines.derain_nerf.raindrop_attention.config import DiscriminatorConfig

KERNEL = 5


class Judgement(NamedTuple):
    """Of pictures [N, 3, H, W]."""

    real: Tensor  # [N], logits
    map: Tensor  # [N, 1, h, w], what features are weighed by; not bounded


class Discriminator(nn.Module):
    """Convolutions, a map of where to look, what is there, one number.

    Any size is taken: what convolutions leave is averaged to `pooled` squares a side before the dense layers.
    """

    def __init__(self, config: DiscriminatorConfig) -> None:
        super().__init__()
        self.config = config
        channels = (3 * config.stride**2, *config.widths)
        self.near = nn.ModuleList(nn.Conv2d(a, b, KERNEL, padding=KERNEL // 2) for a, b in pairwise(channels))
        self.map = nn.Conv2d(config.widths[-1], 1, KERNEL, padding=KERNEL // 2)
        reduced = (config.widths[-1], *config.reduced)
        self.far = nn.ModuleList(nn.Conv2d(a, b, KERNEL, stride=4, padding=1) for a, b in pairwise(reduced))
        self.dense = nn.Linear(config.reduced[-1] * config.pooled**2, config.hidden)
        self.last = nn.Linear(config.hidden, 1)

    def forward(self, picture: Tensor) -> Judgement:
        """Of pictures [N, 3, H, W], H and W multiples of the stride."""
        x = functional.pixel_unshuffle(picture, self.config.stride)
        for layer in self.near:
            x = functional.leaky_relu(layer(x), 0.2)
        where = self.map(x)
        x = x * where
        for layer in self.far:
            x = functional.leaky_relu(layer(x), 0.2)
        x = functional.adaptive_avg_pool2d(x, self.config.pooled).flatten(1)
        return Judgement(self.last(functional.leaky_relu(self.dense(x), 0.2))[:, 0].float(), where.float())
