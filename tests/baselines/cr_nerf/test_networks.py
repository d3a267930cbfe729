"""The networks of CR-NeRF by hand, layer by layer: styles, masks, and the cross-ray transform."""

import numpy as np
import pytest
import torch
from by_hand import applied, convolved, leaky, shaken

from baselines.cr_nerf.config import StyleConfig, TransformConfig, TransientConfig
from baselines.cr_nerf.style import SLOPE, StyleEncoder
from baselines.cr_nerf.transform import CrossRayTransform, Mixing
from baselines.cr_nerf.transients import TransientNetwork, read

CONFIG = TransformConfig(size=3, hidden=(6, 4))


def features(*shape, seed=0):
    values = torch.rand(*shape, generator=torch.Generator().manual_seed(seed))
    return values - values.mean(-2, keepdim=True)


def mixing():
    return Mixing(CONFIG, 5, torch.Generator().manual_seed(0))


def transform(config=CONFIG):
    return CrossRayTransform(config, 5, torch.Generator().manual_seed(0))


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
    network, smaller, rays = transform(TransformConfig(size=5, hidden=(4,))), transform(), features(40, 5)
    colours = network(rays, torch.eye(5)[None], torch.zeros(1, 5))
    torch.testing.assert_close(colours, torch.sigmoid(network.exit(rays)))
    kept = smaller.expand(smaller.compress(rays))
    torch.testing.assert_close(smaller.expand(smaller.compress(kept)), kept)  # a projection


def encoder(**changes):
    config = StyleConfig(**{"channels": (2, 3, 4), "side": 16, **changes})
    return StyleEncoder(config, 5, torch.Generator().manual_seed(0))


def assert_makes(network, picture, expected):
    found = network(torch.from_numpy(picture[None]).float())[0].detach()
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-5)


def pooled(x):
    """The largest values of blocks of 2 x 2 pixels."""
    channels, height, width = x.shape
    return x.reshape(channels, height // 2, 2, width // 2, 2).max(axis=(2, 4))


def test_the_map_is_that_of_its_layers():
    network = shaken(encoder())
    picture = np.random.default_rng(0).uniform(-1, 1, (3, 16, 16))
    x = convolved(network.colours, picture)
    for layer in network.first:
        x = leaky(convolved(layer, x), SLOPE)
    x = pooled(x)
    for layer in network.second:
        x = leaky(convolved(layer, x), SLOPE)
    x = leaky(convolved(network.third[0], pooled(x)), SLOPE)
    assert_makes(network, picture, leaky(convolved(network.exit, x), SLOPE).reshape(5, 16).T)


@pytest.mark.parametrize(("side", "places"), [(8, 4), (24, 36), (31, 49)])
def test_maps_have_a_sixteenth_of_the_places_of_a_picture(side, places):
    maps = encoder(channels=(2, 2, 2), side=side)(torch.zeros(2, 3, side, side))
    assert maps.shape == (2, places, 5)
    assert torch.isfinite(maps).all()


def masking(**changes):
    config = TransientConfig(**{"channels": 3, "dilations": (1, 2), "side": 12, "at_first": 0.05, **changes})
    return TransientNetwork(config, torch.Generator().manual_seed(0))


def test_masks_are_those_of_the_layers():
    made = shaken(masking())
    picture = np.random.default_rng(0).uniform(-1, 1, (3, 12, 12))
    x = leaky(convolved(made.entry, picture), SLOPE)
    for layer in made.dilated:
        x = x + leaky(convolved(layer, x), SLOPE)
    expected = 1 / (1 + np.exp(-convolved(made.exit, x)[0]))
    assert expected.shape == (6, 6)
    assert_makes(made, picture, expected)


@pytest.mark.parametrize("at_first", [0.05, 0.5])
def test_masks_start_the_same_everywhere(at_first):
    masks = masking(dilations=(1,), at_first=at_first)(torch.rand(2, 3, 12, 12))
    np.testing.assert_allclose(masks.detach(), np.full((2, 6, 6), at_first), rtol=1e-6)


def test_masks_are_read_bilinearly():
    masks = torch.rand(3, 5, 7, generator=torch.Generator().manual_seed(0))
    places, which = torch.rand(200, 2, generator=torch.Generator().manual_seed(1)), torch.arange(200) % 3
    grid = (2 * places.flip(1) - 1)[None, None].expand(3, -1, -1, -1)
    expected = torch.nn.functional.grid_sample(masks[:, None], grid, padding_mode="border", align_corners=False)
    torch.testing.assert_close(read(masks, which, places), expected[which, 0, 0, torch.arange(200)])
