import math

import pytest
import torch
from tiny_attention import DISCRIMINATOR, GENERATOR, TRAINING

from baselines.derain_nerf.raindrop_attention.autoencoder import Frames, frames_of
from baselines.derain_nerf.raindrop_attention.discriminator import Discriminator, Judgement
from baselines.derain_nerf.raindrop_attention.losses import (
    adversarial_loss,
    attention_loss,
    discriminator_loss,
    generator_losses,
    perceptual_loss,
    scale_loss,
)
from baselines.derain_nerf.raindrop_attention.network import DerainGenerator


def test_maps_of_means_of_their_pixels_count_more_the_later_they_are():
    cover = torch.ones(1, 1, 4, 4)
    maps = [torch.full((1, 1, 2, 2), value) for value in (0.5, 0.9, 0.8)]
    assert attention_loss(maps, cover, 0.8).item() == pytest.approx(0.64 * 0.25 + 0.8 * 0.01 + 0.04)
    corner = torch.tensor([[1.0, 0, 0, 0], [0, 0, 0, 0]])[None, None]
    assert attention_loss([torch.tensor([[0.25, 0]])[None, None]], corner, 0.8).item() == 0


def test_scales_are_weighed():
    clean = torch.rand(2, 3, 8, 8)
    away = Frames(*(frame + error for frame, error in zip(frames_of(clean), (0.1, 0.2, 0.3), strict=True)))
    expected = 0.6 * 0.01 + 0.8 * 0.04 + 0.09
    assert scale_loss(away, clean, (0.6, 0.8, 1.0)).item() == pytest.approx(expected, rel=1e-5)


def test_adversaries_agree_with_their_logarithms():
    logits, real = torch.tensor([0.3, -2.0]), torch.tensor([1.5, 0.1])
    sigmoid = lambda z: 1 / (1 + math.exp(-z))  # noqa: E731
    fooled = [math.log(1 - sigmoid(z)) for z in logits.tolist()]
    assert adversarial_loss(logits).item() == pytest.approx(sum(fooled) / 2)
    seen = Judgement(logits, torch.full((2, 1, 2, 2), 0.5)), Judgement(real, torch.full((2, 1, 2, 2), 0.2))
    attention = torch.full((2, 1, 8, 8), 0.9)
    expected = -sum(math.log(sigmoid(z)) for z in real.tolist()) / 2 - sum(fooled) / 2 + 0.05 * (0.16 + 0.04)
    assert discriminator_loss(*seen, attention, 0.05).item() == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("network", ["alex", "vgg"])
def test_the_same_picture_is_perceived_the_same(network):
    torch.manual_seed(0)
    clean = torch.rand(1, 3, 48, 48)
    assert perceptual_loss(clean, clean, network).item() == 0
    near, far = (perceptual_loss((clean + d).clamp(0, 1), clean, network).item() for d in (0.05, 0.3))
    assert 0 < near < far


@pytest.mark.parametrize("level", [None, 0, 1])
def test_gradients_are_finite_where_nothing_is_to_be_done(level):
    clean = torch.rand(1, 3, 48, 48) if level is None else torch.full((1, 3, 48, 48), float(level))
    generator, discriminator = DerainGenerator(GENERATOR), Discriminator(DISCRIMINATOR)
    found = generator(clean)
    judged = discriminator(found.frames.whole)
    losses = generator_losses(found, clean, torch.zeros_like(clean[:, :1]), judged, TRAINING.losses)
    assert losses.scales.item() == losses.perceptual.item() == 0
    losses.total(TRAINING.losses).backward()
    judged = discriminator(found.frames.whole.detach())
    discriminator_loss(judged, discriminator(clean), found.maps[-1].detach(), 0.05).backward()
    gradients = [parameter.grad for network in (generator, discriminator) for parameter in network.parameters()]
    assert all(gradient is not None and torch.isfinite(gradient).all() for gradient in gradients)
