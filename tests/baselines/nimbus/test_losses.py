import numpy as np
import pytest
import torch

from baselines.nimbus.losses import dark_channel, dark_loss, total_variation


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
