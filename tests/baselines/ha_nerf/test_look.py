"""The encoder of looks: its convolutions by hand, and its sizes."""

import numpy as np
import pytest
import torch
from by_hand import convolved

from baselines.ha_nerf.config import LookConfig
from baselines.ha_nerf.look import LookEncoder
from baselines.training.images import TrainingImages
from baselines.volumetric.rays.photographs import as_seen, small_pictures

CONFIG = LookConfig(size=5, channels=(3, 4, 6), side=16)


def encoder(config=CONFIG):
    return LookEncoder(config, torch.Generator().manual_seed(0))


def test_the_look_is_that_of_its_formula():
    network = encoder()
    with torch.no_grad():
        for layer in (network.entry, *network.halving):
            layer.bias.uniform_(-0.2, 0.2, generator=torch.Generator().manual_seed(1))
    picture = np.random.default_rng(0).uniform(-1, 1, (3, 11, 9))
    x = np.maximum(convolved(network.entry, picture), 0)
    for layer in network.halving:
        x = np.maximum(convolved(layer, x), 0)
    expected = network.exit.weight.detach().double().numpy() @ x.mean((1, 2)) + network.exit.bias.detach().numpy()
    np.testing.assert_allclose(
        network(torch.from_numpy(picture[None]).float())[0].detach(), expected, rtol=1e-4, atol=1e-5
    )


@pytest.mark.parametrize("size", [(240, 320), (24, 32), (9, 400), (2, 2)])
def test_a_picture_of_any_size_has_a_look(size):
    config = LookConfig(size=7, channels=(4, 4, 4, 4, 4), side=16)
    pictures = small_pictures(TrainingImages([np.full((*size, 3), 100, np.uint8)] * 2), config.side)
    assert pictures.shape == (2, 3, 16, 16)
    looks = encoder(config)(as_seen(pictures))
    assert looks.shape == (2, 7)
    assert torch.isfinite(looks).all()
