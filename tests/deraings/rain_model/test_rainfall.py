"""Falling rain: how much of it a network's pictures show, and single streaks."""

import numpy as np
import panorama
import pytest
from pretended_network import PretendedNetwork

from baselines.training.images import TrainingImages
from deraings.rain_model.config import RainConfig
from deraings.rain_model.model import RainModel
from deraings.rain_model.rainfall import EVEN, MOST, MOST_OVER_MEAN, Rainfall
from hydroviews.rain.streaks.recipe import StreakPattern, composite, streak_layer

COUNT, SIZE, BETA = 10, (121, 160), 0.88
PATTERN = StreakPattern(n=200, length=30, angle=75, width=5)


@pytest.fixture(scope="module")
def scene():
    return np.minimum(panorama.views_of(panorama.paint(size=(250, 400)), COUNT, size=SIZE), 0.6).astype(np.float32)


@pytest.fixture(scope="module")
def layers():
    rng = np.random.default_rng(7)
    return np.stack([streak_layer(PATTERN, SIZE[1], SIZE[0], rng) for _ in range(COUNT)])


def images_of(pictures, hidden=()):
    return TrainingImages(panorama.eight_bit(pictures), hidden)


def rained_on(scene, layers):
    """The scene [N, H, W, 3] with streaks [N, H, W] in front."""
    return np.stack([composite(view, layer, BETA) for view, layer in zip(scene, layers, strict=True)])


def rain_of(scene, layers, share=1.0, hidden=()):
    """Rain as found by a network that removes a share of the streaks."""
    photographs = rained_on(scene, layers)
    left = rained_on(scene, (1 - share) * layers)
    covers = np.zeros(layers.shape, np.float32)
    network = PretendedNetwork(left, covers, hidden=hidden, photographs=photographs)
    return Rainfall(images_of(photographs, hidden), network, BETA)


def test_single_streaks_are_where_the_network_removes_them(scene, layers):
    rain = rain_of(scene, layers)
    for view, layer in enumerate(layers):
        found = rain.alpha(view, SIZE)
        assert np.median(found) == pytest.approx(rain.even_alpha, abs=0.01)
        assert np.corrcoef(found.ravel(), layer.ravel())[0, 1] > 0.95


def test_even_rain_grows_faster_than_its_mean(scene, layers):
    found = [rain_of(scene, factor * layers).even_alpha for factor in (0.25, 0.5, 1.0)]
    assert found[1] / found[0] == pytest.approx(4, rel=0.15)
    assert found[2] == pytest.approx(EVEN * layers.mean() ** 2, rel=0.15)
    haze = rain_of(scene, np.full_like(layers, 0.3))  # without single streaks
    assert haze.even_alpha == pytest.approx(MOST_OVER_MEAN * 0.3, rel=0.02)


def test_where_the_network_changes_nothing_it_does_not_rain(scene, layers):
    rain = rain_of(scene, layers, share=0.0)
    assert rain.even_alpha == pytest.approx(0, abs=1e-3)
    assert rain.alpha(0, SIZE).max() < 0.02
    assert not rain.falls


def test_pictures_lighter_than_rain_show_none(layers):
    rain = rain_of(np.ones((COUNT, *SIZE, 3), np.float32), layers)
    assert rain.even_alpha == 0
    assert not rain.alpha(0, SIZE).any()


def test_hidden_pixels_show_even_rain_alone(scene, layers):
    hidden = [np.zeros(SIZE, bool) for _ in range(COUNT)]
    hidden[2][:, :80] = True
    hidden[3][:] = True
    rain = rain_of(scene, layers, hidden=hidden)
    assert rain.alpha(2, SIZE)[:, :80] == pytest.approx(rain.even_alpha, abs=1 / 255)
    assert rain.alpha(2, SIZE)[:, 80:].std() > 0.02
    assert rain.alpha(3, SIZE) == pytest.approx(rain.even_alpha, abs=1 / 255)
    wrong = scene.copy()
    wrong[2, :, :80] = 0  # of which nothing is to be concluded
    assert rain_of(wrong, layers, hidden=hidden).even_alpha == pytest.approx(rain.even_alpha, rel=1e-3)


def test_covers_are_shares_at_any_size(scene, layers):
    rain = rain_of(scene, 3 * layers.clip(0, 0.3))
    for size in (SIZE, (60, 80)):
        alpha = rain.alpha(1, size)
        assert (alpha.dtype, alpha.shape) == (np.float32, size)
        assert 0 <= alpha.min() <= alpha.max() <= MOST + 0.01


@pytest.mark.parametrize("change", ["streaks", "drops", "mist"])
def test_rain_counts_only_where_streaks_are_removed(scene, layers, change):
    """A network that removes drops or mist changes pictures as well."""
    photographs = rained_on(scene, layers)
    covers = np.full(layers.shape, 1.0 if change == "drops" else 0.0, np.float32)
    network = PretendedNetwork(scene, covers, photographs=scene if change == "mist" else photographs)
    config = RainConfig(mist=None, drops=None, occlusion=None)
    model = RainModel(images_of(photographs), 100, config, network)
    assert model.needed() == (["rain"] if change == "streaks" else [])
    assert model.rain_alpha(0, SIZE).any() == (change == "streaks")


def test_single_streaks_are_not_looked_for_in_drops(scene, layers):
    covers = np.zeros(layers.shape, np.float32)
    covers[:, :60] = 0.5
    photographs = rained_on(scene, layers)
    rain = Rainfall(images_of(photographs), PretendedNetwork(scene, covers, photographs=photographs), BETA)
    alpha = rain.alpha(4, SIZE)
    assert rain.falls
    assert alpha[:60] == pytest.approx(rain.even_alpha, abs=1 / 255)
    assert alpha[70:].std() > 0.02


def test_changes_that_are_the_networks_own_errors_are_no_rain(scene, layers):
    photographs = rained_on(scene, layers)
    network = PretendedNetwork(scene, np.zeros(layers.shape, np.float32), photographs=photographs)
    network.finds_rain = False
    assert not Rainfall(images_of(photographs), network, BETA).falls
