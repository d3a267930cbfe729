"""The encoder of styles and the masks from photographs: their layers by hand, their sizes and start."""

import numpy as np
import pytest
import torch
from by_hand import convolved, leaky, shaken

from baselines.cr_nerf.config import StyleConfig, TransientConfig
from baselines.cr_nerf.style import SLOPE, StyleEncoder
from baselines.cr_nerf.transients import TransientNetwork, read

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


def masking(**changes):
    config = TransientConfig(**{"channels": 3, "dilations": (1, 2), "side": 12, "at_first": 0.05, **changes})
    return TransientNetwork(config, torch.Generator().manual_seed(0))


def test_masks_are_those_of_the_layers():
    made = shaken(masking())
    picture = np.random.default_rng(0).uniform(-1, 1, (3, 12, 12))
    x = leaky(convolved(made.entry, picture), SLOPE)
    for layer in made.dilated:
        x = x + leaky(convolved(layer, x), SLOPE)
    expected = 1 / (1 + np.exp(-convolved(made.exit, x)[0]))
    assert expected.shape == (6, 6)
    found = made(torch.from_numpy(picture[None]).float())[0].detach()
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("at_first", [0.05, 0.5])
def test_masks_start_the_same_everywhere(at_first):
    masks = masking(dilations=(1,), at_first=at_first)(torch.rand(2, 3, 12, 12))
    np.testing.assert_allclose(masks.detach(), np.full((2, 6, 6), at_first), rtol=1e-6)


def test_masks_are_read_bilinearly():
    masks = torch.rand(3, 5, 7, generator=torch.Generator().manual_seed(0))
    places = torch.rand(200, 2, generator=torch.Generator().manual_seed(1))
    which = torch.arange(200) % 3
    grid = (2 * places.flip(1) - 1)[None, None].expand(3, -1, -1, -1)
    expected = torch.nn.functional.grid_sample(masks[:, None], grid, padding_mode="border", align_corners=False)
    torch.testing.assert_close(read(masks, which, places), expected[which, 0, 0, torch.arange(200)])
