"""Masks from photographs: their layers by hand, their start, and how they are read."""

import numpy as np
import pytest
import torch
from by_hand import convolved, leaky, shaken

from baselines.cr_nerf.config import TransientConfig
from baselines.cr_nerf.style import SLOPE
from baselines.cr_nerf.transients import TransientNetwork, read

CONFIG = TransientConfig(channels=3, dilations=(1, 2), side=12, at_first=0.05)


def network(config=CONFIG):
    return TransientNetwork(config, torch.Generator().manual_seed(0))


def test_masks_are_those_of_the_layers():
    made = shaken(network())
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
    made = network(TransientConfig(channels=3, dilations=(1,), side=12, at_first=at_first))
    masks = made(torch.rand(2, 3, 12, 12))
    np.testing.assert_allclose(masks.detach(), np.full((2, 6, 6), at_first), rtol=1e-6)


def test_masks_are_read_bilinearly():
    masks = torch.rand(3, 5, 7, generator=torch.Generator().manual_seed(0))
    places = torch.rand(200, 2, generator=torch.Generator().manual_seed(1))
    which = torch.arange(200) % 3
    grid = (2 * places.flip(1) - 1)[None, None].expand(3, -1, -1, -1)
    expected = torch.nn.functional.grid_sample(masks[:, None], grid, padding_mode="border", align_corners=False)
    torch.testing.assert_close(read(masks, which, places), expected[which, 0, 0, torch.arange(200)])
