"""Masks: their start, what they settle at for a given error and price, and how the price follows visits and errors."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from baselines.ha_nerf.config import VisibilityConfig
from baselines.ha_nerf.visibility import GREY, LEAST, Running, Visibility, price_of_masking

CONFIG = VisibilityConfig(code=8, octaves=4, width=16, layers=2)
RELATIVE = replace(CONFIG, price=3.5, price_at_first=3.5, price_fall=0.0, relative=True)


@pytest.mark.parametrize("at_first", [0.05, 0.5])
def test_masks_start_the_same_everywhere(at_first):
    network = Visibility(replace(CONFIG, at_first=at_first), 5, torch.Generator().manual_seed(0))
    places = torch.rand(40, 2, generator=torch.Generator().manual_seed(1))
    m = network(torch.arange(40) % 5, places)
    np.testing.assert_allclose(m.detach(), at_first, rtol=1e-6)


def test_a_free_mask_settles_where_its_price_says():
    """0.5 (1 - m) e + lambda m^2, minimised in float64 over [0, 1], against e / (4 lambda)."""
    errors = torch.tensor([0.0, 1e-4, 1e-3, 5e-3, 0.02, 0.3], dtype=torch.float64)
    price = 6e-3
    m = torch.full_like(errors, 0.5, requires_grad=True)
    for _ in range(4000):
        loss = (0.5 * (1 - m) * errors + price * m**2).sum()
        (gradient,) = torch.autograd.grad(loss, m)
        m = (m - 20 * gradient).clamp(0, 1).detach().requires_grad_()
    np.testing.assert_allclose(m.detach(), np.minimum(1, errors / (4 * price)), atol=1e-9)
    relative = 3.5 * np.median(errors)
    assert np.median(errors) / (4 * relative) == pytest.approx(1 / 14)


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


def test_the_mask_of_a_view_is_that_of_its_pixels():
    network = Visibility(VisibilityConfig(), 3, torch.Generator().manual_seed(0))
    with torch.no_grad():
        network.exit.weight.normal_(generator=torch.Generator().manual_seed(1))
        plane = network.plane(1, (4, 6))
        alone = network(torch.tensor([1]), torch.tensor([[2.5 / 4, 0.5 / 6]]))
    assert plane.shape == (4, 6)
    assert plane.std() > 0
    assert plane[2, 0] == pytest.approx(float(alone), abs=1e-6)


def test_the_published_price_falls_with_visits_of_a_view():
    running = Running(10, 1, 0.5)
    assert float(price_of_masking(VisibilityConfig(), running)) == pytest.approx(5e-2)
    seen = torch.ones(4), torch.zeros(4), torch.ones(4, dtype=torch.bool)
    for _ in range(20):
        running.observe(*seen)
    assert running.visits == 2
    assert float(price_of_masking(VisibilityConfig(), running)) == pytest.approx(5e-2 * math.exp(-1.5))
    for _ in range(30):
        running.observe(*seen)
    assert float(price_of_masking(VisibilityConfig(), running)) == pytest.approx(6e-3)  # e^(-3.75) would be 1.2e-3


def test_a_relative_price_follows_the_median_error_of_what_counts():
    running = Running(4, 2, 0.05)
    assert float(price_of_masking(RELATIVE, running)) == pytest.approx(3.5 * GREY)
    errors, m = torch.tensor([9.0, 0.02, 0.01, 0.04]), torch.tensor([1.0, 0.1, 0.2, 0.3])
    counts = torch.tensor([False, True, True, True])
    running.observe(errors, m, counts)
    kept = 0.5 ** (2 / 4)
    assert float(running.typical) == pytest.approx(kept * GREY + (1 - kept) * 0.02)
    assert float(running.masked) == pytest.approx(kept * 0.05 + (1 - kept) * 0.2)
    running.observe(errors, m, torch.zeros(4, dtype=torch.bool))  # nothing counts: nothing is learned of it
    assert float(running.typical) == pytest.approx(kept * GREY + (1 - kept) * 0.02)
    assert running.visits == 1
    for _ in range(200):
        running.observe(torch.zeros(4), m, counts)
    assert float(price_of_masking(RELATIVE, running)) == pytest.approx(3.5 * LEAST)  # masking never costs nothing


def test_settings_that_make_no_sense_are_refused():
    with pytest.raises(ValueError, match="at_first 0"):
        VisibilityConfig(at_first=0.0)
    with pytest.raises(ValueError, match="price 0"):
        VisibilityConfig(price=0.0)
    with pytest.raises(ValueError, match=r"price 0\.1"):
        VisibilityConfig(price=0.1)
