"""The cross-ray transform: its formulas in float64, its start as the identity, and what it depends on."""

import numpy as np
import pytest
import torch
from by_hand import applied, leaky, shaken

from baselines.cr_nerf.config import TransformConfig
from baselines.cr_nerf.style import SLOPE
from baselines.cr_nerf.transform import CrossRayTransform, Mixing

CONFIG = TransformConfig(size=3, hidden=(6, 4))


def features(*shape, seed=0):
    values = torch.rand(*shape, generator=torch.Generator().manual_seed(seed))
    return values - values.mean(-2, keepdim=True)


def mixing(config=CONFIG, size=5):
    return Mixing(config, size, torch.Generator().manual_seed(0))


def transform(config=CONFIG, size=5):
    return CrossRayTransform(config, size, torch.Generator().manual_seed(0))


def matrix_by_hand(network, x):
    """A(X) of [n, C], place by place, in float64."""
    for layer in network.layers[:-1]:
        x = leaky(applied(layer, x), SLOPE)
    z = applied(network.layers[-1], x)
    covariance = sum(np.outer(place, place) for place in z) / len(z)
    return applied(network.fc, covariance.ravel()).reshape(network.size, network.size)


def test_colours_are_those_of_the_formula():
    content, style, network = shaken(mixing()), shaken(mixing(), 0.5), shaken(transform())
    rays, places, mean = features(40, 5), features(9, 5, seed=1), torch.rand(5)
    matrix = style(places[None])[0] @ content(rays[None])[0]
    found = network(rays, matrix[None], mean[None])
    t = matrix_by_hand(style, places.double().numpy()) @ matrix_by_hand(content, rays.double().numpy())
    compressed = applied(network.compress, rays.double().numpy())
    out = applied(network.expand, compressed @ t.T) + mean.double().numpy()
    expected = 1 / (1 + np.exp(-applied(network.exit, out)))
    np.testing.assert_allclose(found.detach(), expected, rtol=2e-5, atol=1e-6)
    assert np.abs(t - np.eye(3)).max() > 0.1  # the matrices did something


def test_sets_of_features_have_matrices_of_their_own():
    network, sets = shaken(mixing()), features(4, 7, 5)
    together = network(sets)
    for one, matrix in zip(sets, together, strict=True):
        torch.testing.assert_close(network(one[None])[0], matrix)
        torch.testing.assert_close(network(one.flip(0)[None])[0], matrix)  # in whatever order


@pytest.mark.parametrize("case", ["any", "the same everywhere", "one place"])
def test_matrices_start_as_the_identity(case):
    sets = features(2, 1 if case == "one place" else 7, 5) * (case != "the same everywhere")
    torch.testing.assert_close(mixing()(sets), torch.eye(3).repeat(2, 1, 1))


def test_with_matrices_as_large_as_the_features_nothing_is_lost_at_first():
    network, rays = transform(TransformConfig(size=5, hidden=(4,))), features(40, 5)
    colours = network(rays, torch.eye(5)[None], torch.zeros(1, 5))
    torch.testing.assert_close(colours, torch.sigmoid(network.exit(rays)))
    smaller = transform()
    kept = smaller.expand(smaller.compress(rays))
    torch.testing.assert_close(smaller.expand(smaller.compress(kept)), kept)  # a projection
