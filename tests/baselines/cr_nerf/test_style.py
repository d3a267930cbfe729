"""The encoder of styles: its layers by hand, its sizes, its settings."""

import numpy as np
import pytest
import torch
from by_hand import convolved, leaky, shaken

from baselines.cr_nerf.config import StyleConfig
from baselines.cr_nerf.style import SLOPE, StyleEncoder

CONFIG = StyleConfig(channels=(2, 3, 4), side=16)


def encoder(config=CONFIG):
    return StyleEncoder(config, 5, torch.Generator().manual_seed(0))


def pooled(x, how):
    """Blocks of 2 x 2 pixels."""
    channels, height, width = x.shape
    return how(x.reshape(channels, height // 2, 2, width // 2, 2), axis=(2, 4))


def test_the_map_is_that_of_its_layers():
    network = shaken(encoder())
    picture = np.random.default_rng(0).uniform(-1, 1, (3, 16, 16))
    x = convolved(network.colours, picture)
    for layer in network.first:
        x = leaky(convolved(layer, x), SLOPE)
    x = pooled(x, np.max)
    for layer in network.second:
        x = leaky(convolved(layer, x), SLOPE)
    x = leaky(convolved(network.third[0], pooled(x, np.max)), SLOPE)
    expected = leaky(convolved(network.exit, x), SLOPE)
    found = network(torch.from_numpy(picture[None]).float())[0].detach()
    np.testing.assert_allclose(found, expected.reshape(5, 16).T, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize(("side", "places"), [(8, 4), (24, 36), (31, 49)])
def test_maps_have_a_sixteenth_of_the_places_of_a_picture(side, places):
    maps = encoder(StyleConfig(channels=(2, 2, 2), side=side))(torch.zeros(2, 3, side, side))
    assert maps.shape == (2, places, 5)
    assert torch.isfinite(maps).all()
