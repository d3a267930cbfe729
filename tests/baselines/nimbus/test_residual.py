"""Residuals that are no part of the scene, and the losses of the medium."""

import logging

import numpy as np
import pytest
import torch

from baselines.nimbus.config import ResidualConfig
from baselines.nimbus.losses import dark_channel, dark_loss, total_variation
from baselines.nimbus.residual import Residuals, beyond

CONFIG = ResidualConfig(threshold=0.1, first=0.2, every=0.1)
GREY = np.full((4, 6, 3), 0.5, np.float32)


def photograph(places, value=0.9):
    picture = GREY.copy()
    for place in places:
        picture[place] = value
    return picture


def test_a_pixel_is_the_residuals_if_it_is_off_by_more_than_the_threshold():
    picture = photograph([(0, 1)])
    picture[1, 2] = 0.2  # darker than expected
    picture[2, 3] = 0.59  # below the threshold
    picture[3, 4] = (0.8, 0.5, 0.5)  # a tenth in the mean is not beyond
    picture[3, 5] = (0.81, 0.5, 0.51)
    assert sorted(zip(*np.nonzero(beyond(picture, GREY, 0.1)), strict=True)) == [(0, 1), (3, 5)]
    hidden = np.zeros((4, 6), bool)
    hidden[0, 1] = True
    assert not beyond(picture, GREY, 0.1, hidden)[0, 1]


def test_it_begins_after_a_while_and_is_made_anew_when_due():
    residuals = Residuals(CONFIG, 2, 100)
    assert residuals.of(photograph([(0, 0)]), GREY, 0, 19, None) is None
    assert residuals.share == 0
    first = residuals.of(photograph([(0, 0)]), GREY, 0, 20, None)
    assert first.sum() == 1
    assert residuals.of(GREY, GREY, 0, 29, None) is first
    assert not residuals.of(GREY, GREY, 0, 30, None).any()
    assert residuals.of(photograph([(0, 0)])[::2, ::2], GREY[::2, ::2], 0, 31, None).shape == (2, 3)  # another size
    assert residuals.share == pytest.approx(1 / 6)
    assert Residuals(None, 2, 100).of(GREY, GREY, 0, 99, None) is None


def test_a_residual_that_eats_everything_is_said_once(caplog):
    residuals = Residuals(CONFIG, 2, 100)
    with caplog.at_level(logging.WARNING):
        residuals.of(GREY + 0.4, GREY, 0, 20, None)
        assert not caplog.records  # the other view has not been seen
        for iteration in range(21, 90):
            residuals.of(GREY + 0.4, GREY, iteration % 2, iteration, None)
    assert [record.message for record in caplog.records if "residuals hold 100 %" in record.message]
    assert len(caplog.records) == 1


def random(*shape):
    return torch.from_numpy(np.random.default_rng(0).random(shape))


def test_the_dark_channel_is_the_least_value_of_each_patch():
    image = torch.full((4, 8, 3), 0.8, dtype=torch.float64)
    image[1, 2, 1] = 0.1
    image[3, 7, 0] = 0.3
    # Patches of 4 x 4 begin at columns 0, 2 and 4.
    assert dark_channel(image, 4).tolist() == [[0.1, 0.1, 0.3]]
    assert dark_loss(image, 0.5).item() == pytest.approx(0.5 / 3)
    assert dark_channel(image, 1).shape == (4, 8)
    assert dark_channel(image, 99).tolist() == [[0.1, 0.1, 0.3]]  # no patch is larger than the picture


def test_the_gradient_of_the_dark_channel_is_that_of_differences():
    image = random(6, 7, 3).requires_grad_()
    dark_loss(image, 3 / 7).backward()
    step, exact = 1e-6, np.zeros(image.shape)
    for place in np.ndindex(*image.shape):
        changed = [image.detach().clone() for _ in range(2)]
        for one, sign in zip(changed, (1, -1), strict=True):
            one[place] += sign * step
        exact[place] = (dark_loss(changed[0], 3 / 7) - dark_loss(changed[1], 3 / 7)) / (2 * step)
    assert np.allclose(image.grad, exact, atol=1e-8)
    assert image.grad.sum().item() == pytest.approx(1)


def test_total_variation_counts_steps_between_neighbours():
    grid = torch.zeros(3, 3, 3, dtype=torch.float64)
    assert total_variation(grid).item() == 0
    grid[1, 1, 1] = 2.0  # two neighbours along each axis, of 18 pairs
    assert total_variation(grid).item() == pytest.approx(3 * 4 / 18)
    ramp = torch.arange(4, dtype=torch.float64).expand(4, 4, 4)
    assert total_variation(ramp).item() == pytest.approx(1)
