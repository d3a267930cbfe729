"""Hash grids against closed forms, plain torch in float64, and themselves on other numbers of threads; encodings."""

import numba
import numpy as np
import pytest
import torch

from baselines.volumetric.fields.encodings import positional
from baselines.volumetric.fields.hash_grid import GridConfig, HashGrid, interpolate

RESOLUTIONS = [4, 11, 40]


def tables(seed=0, entries=2**9, dtype=torch.float32):
    return torch.randn(3, entries, 4, generator=torch.Generator().manual_seed(seed)).to(dtype)


def points(n, seed=0):
    return torch.rand(n, 3, generator=torch.Generator().manual_seed(seed))


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
    grid = grid_of(tables(), RESOLUTIONS)
    outside = torch.tensor([[1.0, 1, 1], [1.5, 2, 9], [0, 0, 0], [-1, -0.5, 0]])
    found = grid(outside).detach()
    assert torch.equal(found[0], found[1])
    assert torch.equal(found[2], found[3])


def test_kernels_and_plain_torch_give_the_same_numbers():
    where, values = points(3000), tables()
    weights = torch.randn(3000, 12, generator=torch.Generator().manual_seed(1))
    grid = grid_of(values, RESOLUTIONS)
    features = grid(where)
    (features * weights).sum().backward()
    double = values.double().requires_grad_()
    exact = interpolate(where.double(), double, RESOLUTIONS)
    (exact * weights).sum().backward()
    # In float32 a point near the border of a cell may fall on its other side, where the interpolant is the same.
    torch.testing.assert_close(features.detach().double(), exact.detach(), atol=2e-5, rtol=0)
    assert (grid.tables.grad - double.grad).abs().max() < 2e-4 * double.grad.abs().max()
    single = values.clone().requires_grad_()
    (interpolate(where, single, RESOLUTIONS) * weights).sum().backward()
    torch.testing.assert_close(features.detach(), interpolate(where, single, RESOLUTIONS).detach(), atol=1e-5, rtol=0)


@pytest.mark.skipif(numba.config.NUMBA_NUM_THREADS < 2, reason="Numba was started with one thread")
def test_the_number_of_threads_does_not_show():
    results = []
    for threads in (1, 2):
        numba.set_num_threads(threads)
        grid = grid_of(tables(), RESOLUTIONS)
        features = grid(points(5000))
        features.square().sum().backward()
        results.append((features.detach(), grid.tables.grad))
    assert torch.equal(results[0][0], results[1][0])
    assert torch.equal(results[0][1], results[1][1])


def test_resolutions_grow_geometrically():
    assert GridConfig(5, 14, 16, 256).resolutions() == [16, 32, 64, 128, 256]
    assert GridConfig(1, 14, 16, 256).resolutions() == [16]


def test_positions_are_followed_by_sines_and_cosines_of_doubled_frequencies():
    x = torch.tensor([[0.25, -0.5, 0.1]])
    expected = [0.25, -0.5, 0.1]
    for wave in (np.sin, np.cos):
        expected += [wave(2.0**k * np.pi * value) for k in range(2) for value in (0.25, -0.5, 0.1)]
    np.testing.assert_allclose(positional(x, 2).numpy()[0], expected, atol=1e-6)
