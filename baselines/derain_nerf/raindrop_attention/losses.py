"""What generator and discriminator learn from (Qian et al. 2018, equations 2 to 9)."""

from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

from baselines.derain_nerf.raindrop_attention.autoencoder import Frames, frames_of
from baselines.derain_nerf.raindrop_attention.config import LossConfig, Perceptual
from baselines.derain_nerf.raindrop_attention.discriminator import Judgement
from baselines.derain_nerf.raindrop_attention.network import Derained
from hydroviews.metrics.lpips import activations

# Of Qian et al. 2018: map t of N counts DECAY^(N - t); weights at a fourth, a half and the whole resolution; gamma.
DECAY, SCALES, MAP_WEIGHT = 0.8, (0.6, 0.8, 1.0), 0.05


class GeneratorLosses(NamedTuple):
    """Each a scalar."""

    attention: Tensor
    scales: Tensor
    perceptual: Tensor
    adversarial: Tensor

    def total(self, config: LossConfig) -> Tensor:
        """Weighed as they are learned from."""
        fixed = self.attention + self.scales + config.perceptual_weight * self.perceptual
        return fixed + config.adversarial * self.adversarial


def generator_losses(
    found: Derained, clean: Tensor, cover: Tensor, judged: Judgement, config: LossConfig
) -> GeneratorLosses:
    """All that the generator learns from.

    Args:
        found: for pictures [N, 3, H, W].
        clean: without drops [N, 3, H, W].
        cover: by drops [N, 1, H, W], [0, 1].
        judged: the discriminator's judgement of `found`.
        config: weights.
    """
    return GeneratorLosses(
        attention_loss(found.maps, cover),
        scale_loss(found.frames, clean),
        perceptual_loss(found.frames.whole, clean, config.perceptual),
        adversarial_loss(judged.real),
    )


def attention_loss(maps: Sequence[Tensor], cover: Tensor, decay: float = DECAY) -> Tensor:
    """Sum over t of decay^(N - t) MSE(A_t, M), M averaged over areas to the maps' resolution."""
    target = functional.adaptive_avg_pool2d(cover, (maps[0].shape[-2], maps[0].shape[-1]))
    last = len(maps) - 1
    return torch.stack([decay ** (last - t) * functional.mse_loss(a, target) for t, a in enumerate(maps)]).sum()


def scale_loss(frames: Frames, clean: Tensor, weights: Sequence[float] = SCALES) -> Tensor:
    """Sum of weighed MSE at a fourth, a half and the whole resolution."""
    pairs = zip(weights, frames, frames_of(clean), strict=True)
    return torch.stack([weight * functional.mse_loss(found, target) for weight, found, target in pairs]).sum()


def perceptual_loss(found: Tensor, clean: Tensor, network: Perceptual) -> Tensor:
    """Mean over levels of the MSE of features that know photographs (Johnson et al. 2016).

    The paper takes VGG16's as trained on ImageNet; these are the same network's activations that LPIPS compares, or
    AlexNet's. They are compared as they are, not as unit vectors, whose gradient is undefined where all are zero.
    """
    with torch.no_grad():
        target = activations(network, clean)
    pairs = zip(activations(network, found), target, strict=True)
    return torch.stack([functional.mse_loss(a, b) for a, b in pairs]).mean()


def adversarial_loss(logits: Tensor) -> Tensor:
    """log(1 - D(O)), O being derained."""
    return -functional.softplus(logits).mean()


def discriminator_loss(derained: Judgement, real: Judgement, attention: Tensor, gamma: float = MAP_WEIGHT) -> Tensor:
    """-log D(R) - log(1 - D(O)) + gamma (MSE(D_map(O), A_N) + MSE(D_map(R), 0)).

    Args:
        derained: of the generator's pictures O.
        real: of dry pictures R.
        attention: A_N, the generator's last map for O [N, 1, h, w].
        gamma: weight of the maps.
    """
    target = functional.adaptive_avg_pool2d(attention, (derained.map.shape[-2], derained.map.shape[-1]))
    judgement = functional.softplus(-real.real).mean() + functional.softplus(derained.real).mean()
    return judgement + gamma * (functional.mse_loss(derained.map, target) + real.map.square().mean())
