"""Hash grids against closed forms, plain torch in float64, and themselves on other numbers of threads; encodings."""

import numpy as np
import torch
from thread_counts import assert_same_on_two_threads

from baselines.volumetric.fields.encodings import positional
from baselines.volumetric.fields.hash_grid import GridConfig, HashGrid, interpolate

RESOLUTIONS = [4, 11, 40]


def tables():
    return torch.randn(3, 2**9, 4, generator=torch.Generator().manual_seed(0))


def points(n):
    return torch.rand(n, 3, generator=torch.Generator().manual_seed(0))


def grid_of(values, resolutions):
    grid = HashGrid(GridConfig(), torch.Generator().manual_seed(0))
    grid.tables, grid.resolutions = torch.nn.Parameter(values), resolutions
    return grid


def test_a_dense_level_reproduces_trilinear_functions():
    cells = 7
    x, y, z = np.meshgrid(*[np.linspace(0, 1, cells + 1)] * 3, indexing="ij")

    def known(x, y, z):
        return np.stack([1 + 0 * x, x - 2 * y, x * y + z, 3 * x * y * z - x * z], -1)

    entries = known(x, y, z).transpose(2, 1, 0, 3).reshape(-1, 4)  # x runs fastest
    table = np.zeros((1, 512, 4), np.float32)
    table[0, : len(entries)] = entries
    where = points(1000)
    found = grid_of(torch.from_numpy(table), [cells])(where).detach()
    np.testing.assert_allclose(found, known(*where.double().numpy().T), atol=2e-6)


def test_borders_and_beyond():
    outside = torch.tensor([[1.0, 1, 1], [1.5, 2, 9], [0, 0, 0], [-1, -0.5, 0]])
    found = grid_of(tables(), RESOLUTIONS)(outside).detach()
    assert torch.equal(found[::2], found[1::2])


def test_kernels_and_plain_torch_give_the_same_numbers():
    where, values = points(3000), tables()
    weights = torch.randn(3000, 12, generator=torch.Generator().manual_seed(1))
    grid, double = grid_of(values, RESOLUTIONS), values.double().requires_grad_()
    features, exact = grid(where), interpolate(where.double(), double, RESOLUTIONS)
    for found in (features, exact):
        (found * weights).sum().backward()
    # In float32 a point near the border of a cell may fall on its other side, where the interpolant is the same.
    torch.testing.assert_close(features.detach().double(), exact.detach(), atol=2e-5, rtol=0)
    assert (grid.tables.grad - double.grad).abs().max() < 2e-4 * double.grad.abs().max()
    torch.testing.assert_close(features.detach(), interpolate(where, values, RESOLUTIONS), atol=1e-5, rtol=0)


def test_the_number_of_threads_does_not_show():
    def learned():
        grid = grid_of(tables(), RESOLUTIONS)
        features = grid(points(5000))
        features.square().sum().backward()
        return features.detach(), grid.tables.grad

    assert_same_on_two_threads(learned)


def test_resolutions_grow_geometrically():
    assert GridConfig(5, 14, 16, 256).resolutions() == [16, 32, 64, 128, 256]
    assert GridConfig(1, 14, 16, 256).resolutions() == [16]


def test_positions_are_followed_by_sines_and_cosines_of_doubled_frequencies():
    x = torch.tensor([[0.25, -0.5, 0.1]])
    expected = [0.25, -0.5, 0.1]
    for wave in (np.sin, np.cos):
        expected += [wave(2.0**k * np.pi * value) for k in range(2) for value in (0.25, -0.5, 0.1)]
    np.testing.assert_allclose(positional(x, 2).numpy()[0], expected, atol=1e-6)
