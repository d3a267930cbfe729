"""Compositing against closed forms, in the cases where it could break."""

import numpy as np
import torch

from baselines.volumetric.compositing import INFINITE, along_ray, compositing_weights, interval_lengths


def test_a_slab_of_constant_density_lets_exp_minus_sigma_d_through():
    edges = torch.linspace(2, 5, 31).expand(4, -1)
    lengths = interval_lengths(edges, torch.tensor([[0, 0, 1.0], [0, 0.6, 0.8], [3, 0, 4], [0, 0, 0.1]]), False)
    weights, left = compositing_weights(torch.full((4, 30), 0.7), lengths)
    expected = np.exp(-0.7 * 3 * np.array([1, 1, 5, 0.1]))
    np.testing.assert_allclose(left, expected, rtol=1e-5)
    np.testing.assert_allclose(weights.sum(1), 1 - expected, rtol=1e-5)
    np.testing.assert_allclose(along_ray(weights, torch.ones(4, 30, 2))[:, 1], 1 - expected, rtol=1e-5)


def test_empty_and_saturated_rays_are_exact():
    density = torch.zeros(4, 6)
    density[1, 2], density[2] = 1e30, 1e8
    density[3, 5] = 1e-3  # only in the last, infinite interval
    density.requires_grad_()
    lengths = torch.ones(4, 6)
    lengths[:, -1] = INFINITE
    weights, left = compositing_weights(density, lengths)
    assert torch.equal(weights[0].detach(), torch.zeros(6))
    assert weights[1].detach().tolist() == [0, 0, 1, 0, 0, 0]
    assert weights[2].detach().tolist() == [1, 0, 0, 0, 0, 0]
    assert weights[3].detach().tolist() == [0, 0, 0, 0, 0, 1]
    assert left.detach().tolist() == [1, 0, 0, 0]
    (weights.square().sum() + left.sum()).backward()
    assert torch.isfinite(density.grad).all()


def test_an_infinite_last_interval_takes_all_that_is_left():
    density = torch.full((1, 5), 0.2)
    lengths = interval_lengths(torch.arange(6.0)[None], torch.tensor([[0, 0, 1.0]]), True)
    weights, left = compositing_weights(density, lengths)
    np.testing.assert_allclose(weights[0, -1], np.exp(-0.8), rtol=1e-6)
    assert float(left[0]) == 0


def test_gradients_are_those_of_float64_differences():
    generator = torch.Generator().manual_seed(0)
    density = torch.rand(3, 7, generator=generator, dtype=torch.float64).requires_grad_()
    lengths = torch.rand(3, 7, generator=generator, dtype=torch.float64)
    assert torch.autograd.gradcheck(lambda d: compositing_weights(d, lengths), density)
