"""Masks: their start, and that they are learned view by view and place by place; the encoder of looks by hand."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from by_hand import convolved

from baselines.ha_nerf.config import LookConfig, VisibilityConfig
from baselines.ha_nerf.look import LookEncoder
from baselines.ha_nerf.visibility import Visibility

CONFIG = VisibilityConfig(code=8, octaves=4, width=16, layers=2)
RELATIVE = replace(CONFIG, price=3.5, relative=True)


@pytest.mark.parametrize("at_first", [0.05, 0.5])
def test_masks_start_the_same_everywhere(at_first):
    network = Visibility(replace(CONFIG, at_first=at_first), 5, torch.Generator().manual_seed(0))
    places = torch.rand(40, 2, generator=torch.Generator().manual_seed(1))
    m = network(torch.arange(40) % 5, places)
    np.testing.assert_allclose(m.detach(), at_first, rtol=1e-6)


def test_the_network_learns_the_mask_of_one_view_and_leaves_the_others():
    """In 200 steps of the ha-nerf loss with given errors: 1 in a corner of view 1, a hundredth elsewhere."""
    network = Visibility(RELATIVE, 3, torch.Generator().manual_seed(0))
    optimiser = torch.optim.Adam(network.parameters(), 1e-2)
    side = (torch.arange(12) + 0.5) / 12
    places = torch.cartesian_prod(side, side).repeat(3, 1)
    views = torch.arange(3).repeat_interleave(144)
    corner = (places < 0.5).all(1) & (views == 1)
    errors = torch.where(corner, 1.0, 0.01)
    for _ in range(200):
        m = network(views, places)
        loss = (0.5 * (1 - m) * errors).mean() + RELATIVE.price * 0.01 * m.square().mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    m = network(views, places)
    assert m[corner].mean() > 0.9
    assert m[views != 1].mean() < 0.15


def test_the_look_is_that_of_its_formula():
    network = LookEncoder(LookConfig(size=5, channels=(3, 4, 6), side=16), torch.Generator().manual_seed(0))
    with torch.no_grad():
        for layer in (network.entry, *network.halving):
            layer.bias.uniform_(-0.2, 0.2, generator=torch.Generator().manual_seed(1))
    picture = np.random.default_rng(0).uniform(-1, 1, (3, 11, 9))
    x = np.maximum(convolved(network.entry, picture), 0)
    for layer in network.halving:
        x = np.maximum(convolved(layer, x), 0)
    expected = network.exit.weight.detach().double().numpy() @ x.mean((1, 2)) + network.exit.bias.detach().numpy()
    found = network(torch.from_numpy(picture[None]).float())[0].detach()
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-5)
