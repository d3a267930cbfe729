"""Reading maps against closed forms and torch's own sampler; the box that holds coordinates."""

import numpy as np
import pytest
import torch
from splats import camera
from torch.nn import functional

from baselines.encoders.sampling import boxed, projected, sample


def points(n, maps, reach=1.3, dtype=torch.float64):
    return reach * (2 * torch.rand(n, maps, 2, generator=torch.Generator().manual_seed(0), dtype=dtype) - 1)


@pytest.mark.parametrize("size", [(5, 8), (1, 6), (6, 1), (1, 1)])
def test_values_and_gradients_are_those_of_torchs_sampler(size):
    maps = torch.rand(3, 4, *size, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    upstream = torch.rand(40, 12, generator=torch.Generator().manual_seed(2), dtype=torch.float64)

    def theirs(m, at):
        grid = at.transpose(0, 1)[:, :, None]
        found = functional.grid_sample(m, grid, mode="bilinear", padding_mode="border", align_corners=False)
        return found[..., 0].permute(2, 0, 1).flatten(1)

    ends = []
    for read in (sample, theirs):
        m, at = maps.clone().requires_grad_(), points(40, 3).requires_grad_()
        values = read(m, at)
        (values * upstream).sum().backward()
        ends.append((values, m.grad, at.grad))
    for ours, expected in zip(*ends, strict=True):
        assert torch.allclose(ours, expected, atol=1e-12)


def test_points_are_seen_where_the_camera_projects_them():
    view = camera(23, 17)
    means = np.random.default_rng(0).uniform(-1, 1, (20, 3)).astype(np.float32)
    pixels, _ = view.project(means)
    expected = 2 * pixels / (view.width, view.height) - 1
    assert np.allclose(projected(torch.from_numpy(means), view).numpy(), expected, atol=1e-5)


def test_the_box_adds_the_gradient_of_its_loss_and_nothing_else():
    x = points(30, 2).requires_grad_()
    twin = x.detach().clone().requires_grad_()
    out = boxed(x, 0.7)
    assert torch.equal(out, x)
    (out**2).sum().backward()
    ((twin**2).sum() + 0.7 * functional.relu(twin.abs() - 1).mean()).backward()
    assert torch.allclose(x.grad, twin.grad, atol=1e-12)
    assert (x.detach().abs() > 1).any()
