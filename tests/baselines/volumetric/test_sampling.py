"""Sampling, compositing and the losses on histograms against closed forms and their definitions."""

import numpy as np
import torch

from baselines.volumetric.compositing import INFINITE, along_ray, compositing_weights, interval_lengths
from baselines.volumetric.rays.sampling import PADDING, annealed, distortion_loss, even_edges, interlevel_loss, resample

CPU = torch.device("cpu")


def histogram(weights):
    weights = torch.tensor(weights)[None]
    return torch.linspace(0, 1, weights.shape[1] + 1)[None], weights


def random_histogram(rays, n, seed):
    generator = torch.Generator().manual_seed(seed)
    inner = torch.rand(rays, n - 1, generator=generator).sort(1).values
    edges = torch.cat([torch.zeros(rays, 1), inner, torch.ones(rays, 1)], 1).double()
    weights = torch.rand(rays, n, generator=generator).double()
    return edges, weights / weights.sum(1, keepdim=True)


def test_even_edges_are_jittered_together():
    edges = even_edges(2, 4, torch.tensor([0.0, 0.75]), CPU)
    np.testing.assert_allclose(edges, [[0, 0.125, 0.375, 0.625, 1], [0, 0.3125, 0.5625, 0.8125, 1]])
    np.testing.assert_allclose(even_edges(1, 2, None, CPU), [[0, 0.5, 1]])


def test_samples_follow_the_analytic_distribution():
    x = (np.arange(400) + 0.5) / 400
    edges, weights = histogram((2 * x).tolist())  # density 2 s, cumulative s^2
    found = resample(edges, weights, 100, None)[0].numpy()
    cumulative = (found**2 + PADDING * found) / (1 + PADDING)
    np.testing.assert_allclose(cumulative, np.linspace(0, 1, 101), atol=1e-5)


def test_empty_rays_are_sampled_evenly_and_sharp_ones_in_order():
    found = resample(*histogram([0.0] * 5), 10, None)
    np.testing.assert_allclose(found, np.linspace(0, 1, 11)[None], atol=1e-6)
    found = resample(*histogram([0.0, 1e-30, 0, 1, 1e-7]), 64, torch.tensor([0.3]), 0.5)
    assert torch.isfinite(found).all()
    assert (found.diff(dim=1) >= 0).all()


def test_sharpness_flattens_the_histogram():
    sharp, soft, none = (
        int((resample(*histogram([0.9, 0.1]), 100, None, sharpness)[0] < 0.5).sum()) for sharpness in (1.0, 0.5, 0.0)
    )
    assert sharp > soft > none == 50
    assert annealed(0, 100) == 0
    assert annealed(100, 100) == annealed(500, 100) == 1
    assert annealed(50, 100) > 0.5


def test_the_interlevel_loss_is_its_definition():
    edges, weights = random_histogram(5, 6, 1)
    proposal_edges, proposal_weights = random_histogram(5, 9, 2)
    expected = np.zeros(5)
    for ray, i in np.ndindex(5, 6):
        overlaps = (proposal_edges[ray, :-1] < edges[ray, i + 1]) & (proposal_edges[ray, 1:] > edges[ray, i])
        lacking = max(0.0, float(weights[ray, i] - proposal_weights[ray][overlaps].sum()))
        expected[ray] += lacking**2 / (float(weights[ray, i]) + 1e-7)
    for ray in range(5):
        found = interlevel_loss(*(a[ray : ray + 1] for a in (edges, weights, proposal_edges, proposal_weights)))
        np.testing.assert_allclose(float(found), expected[ray], rtol=1e-6, atol=1e-12)
    coarse, merged = edges[:, ::3].contiguous(), weights.reshape(5, 2, 3).sum(2)
    for enough in ((edges, weights), (coarse, merged)):
        assert float(interlevel_loss(edges, weights, *enough).max()) < 1e-12


def test_the_distortion_loss_is_its_definition():
    edges, weights = random_histogram(5, 8, 3)
    middles, lengths = (edges[:, 1:] + edges[:, :-1]) / 2, edges.diff(dim=1)
    pairs = weights[:, :, None] * weights[:, None] * (middles[:, :, None] - middles[:, None]).abs()
    expected = pairs.sum((1, 2)) + (weights**2 * lengths).sum(1) / 3
    np.testing.assert_allclose(distortion_loss(edges, weights), expected, rtol=1e-9)


def test_a_slab_of_constant_density_lets_exp_minus_sigma_d_through():
    edges = torch.linspace(2, 5, 31).expand(4, -1)
    lengths = interval_lengths(edges, torch.tensor([[0, 0, 1.0], [0, 0.6, 0.8], [3, 0, 4], [0, 0, 0.1]]), False)
    weights, left = compositing_weights(torch.full((4, 30), 0.7), lengths)
    expected = np.exp(-0.7 * 3 * np.array([1, 1, 5, 0.1]))
    np.testing.assert_allclose(left, expected, rtol=1e-5)
    np.testing.assert_allclose(weights.sum(1), 1 - expected, rtol=1e-5)
    np.testing.assert_allclose(along_ray(weights, torch.ones(4, 30, 2))[:, 1], 1 - expected, rtol=1e-5)


def test_empty_and_saturated_rays_are_exact():
    density, lengths = torch.zeros(4, 6), torch.ones(4, 6)
    density[1, 2], density[2] = 1e30, 1e8
    density[3, 5] = 1e-3  # only in the last, infinite interval
    lengths[:, -1] = INFINITE
    weights, left = compositing_weights(density.requires_grad_(), lengths)
    expected = torch.zeros(4, 6)
    expected[1, 2] = expected[2, 0] = expected[3, 5] = 1
    assert torch.equal(weights.detach(), expected)
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
    density, lengths = torch.rand(2, 3, 7, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    assert torch.autograd.gradcheck(lambda d: compositing_weights(d, lengths), density.clone().requires_grad_())
