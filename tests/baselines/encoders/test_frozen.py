"""Frozen features: their shapes, what they tell apart, and how they are standardised."""

import numpy as np
import pytest
import torch

from baselines.encoders.frozen import AlexNet, frozen, shrunk, standardise, unlikeness
from hydroviews.errors import InputError


def test_alexnet_tells_a_blurred_picture_from_another():
    generator = np.random.default_rng(0)
    one, other = (generator.random((12, 16, 3)).repeat(8, 0).repeat(8, 1).astype(np.float32) for _ in range(2))
    network = AlexNet("cpu")
    dim = unlikeness(network(one), network(0.7 * one + 0.1))
    assert unlikeness(network(one), network(one)).max() == 0
    assert dim.mean() < 0.2
    assert unlikeness(network(one), network(other)).mean() > 0.25
    assert network(one).shape == (384, 5, 7)
    with pytest.raises(InputError, match="too small"):
        network(one[:20])
    assert shrunk(np.zeros((700, 525, 3), np.float32)).shape == (350, 262, 3)


def test_features_are_standardised_over_all_pictures_and_constant_ones_vanish():
    made = [3 + 2 * torch.randn(5, 8, 6, generator=torch.Generator().manual_seed(k)) for k in range(3)]
    for seen in made:
        seen[4] = 7
    standardise(made)
    found = torch.cat([seen.double().flatten(1) for seen in made], dim=1)
    assert torch.allclose(found[:4].mean(dim=1), torch.zeros(4, dtype=torch.float64), atol=1e-3)
    assert torch.allclose(found[:4].std(dim=1, correction=0), torch.ones(4, dtype=torch.float64), atol=1e-3)
    assert not found[4].any()


def test_vgg_has_a_position_for_four_by_four_pixels():
    network = frozen("vgg", "cpu")
    image = np.random.default_rng(0).random((36, 48, 3)).astype(np.float32)
    assert network(image).shape == (256, 9, 12)
    with pytest.raises(InputError, match="too small"):
        network(image[:12])
