import numpy as np
import panorama
import pytest

from deraings.rain_model.rain_layer import RainLayer, RainLayerConfig
from hydroviews.rain.streaks.recipe import StreakPattern, composite, streak_layer

COUNT, SIZE = 10, (121, 160)
PATTERN = StreakPattern(n=200, length=30, angle=75, width=5)


def rained_on(scene, brightness=0.88):
    """The views with the paper's streaks, and the streaks' layers."""
    rng = np.random.default_rng(7)
    layers = [streak_layer(PATTERN, SIZE[1], SIZE[0], rng) for _ in scene]
    return np.stack([composite(v, s, brightness) for v, s in zip(scene, layers, strict=True)]), np.stack(layers)


def watch(photographs, seen, weights=None):
    layer = RainLayer(100, RainLayerConfig(memory=1000, min_updates=0))
    for photograph, expected in zip(photographs, seen, strict=True):
        layer.update(photograph, expected.astype(np.float32), weights, iteration=30)
    return layer


@pytest.fixture(scope="module")
def scene():
    return panorama.views_of(panorama.paint(size=(250, 400)), COUNT, size=SIZE)


def learned(scene, cover, brightness=0.88):
    """The scene as it is learned through rain of that median cover, with an error."""
    error = 0.02 * np.random.default_rng(3).standard_normal(scene.shape)
    return scene * (1 - cover) + brightness * cover + error


def test_more_updates_than_are_remembered_cannot_be_asked_for():
    with pytest.raises(ValueError, match="could never be believed"):
        RainLayerConfig(memory=14)
    with pytest.raises(ValueError, match="no more than dry"):
        RainLayerConfig(rainy=0.05)


def test_the_median_alpha_is_found(scene):
    photographs, layers = rained_on(scene)
    cover = float(np.median(layers))
    layer = watch(photographs, learned(scene, cover))
    assert layer.certainty() == 1
    assert layer.alpha[0] == pytest.approx(cover, abs=0.05)
    assert abs(layer.angle() - PATTERN.angle) <= 15


@pytest.mark.parametrize("fog", [0.0, 0.5])
def test_it_does_not_rain_in_dry_views_nor_in_fog(scene, fog):
    pale = scene * (1 - fog) + 0.7 * fog
    layer = watch(pale, learned(pale, 0))
    assert layer.certainty() == 0
    assert layer.alpha[0] == 0


def test_rain_before_fog_is_not_taken_for_the_fog(scene):
    pale = scene * 0.5 + 0.35
    photographs, layers = rained_on(pale)
    cover = float(np.median(layers))
    layer = watch(photographs, learned(pale, cover))
    assert layer.alpha[0] == pytest.approx(cover, abs=0.08)


def test_pixels_without_weight_are_not_looked_at(scene):
    photographs, _ = rained_on(scene)
    layer = watch(photographs, learned(scene, 0.1), np.zeros(scene.shape[1:3], np.float32))
    assert layer.alpha[0] == 0


def test_a_view_that_is_nearly_all_light_tells_nothing(scene):
    photographs, layers = rained_on(scene)
    seen = learned(scene, float(np.median(layers)))
    snow = np.ones(SIZE, bool)
    snow[:4] = False  # less than a twentieth is left
    photographs[:, snow], seen[:, snow] = 0.9, 0.8
    assert not watch(photographs, seen).powers.any()


def test_a_view_behind_rain_and_its_gradient_are_the_plain_formulas(scene):
    layer, image = RainLayer(100, RainLayerConfig()), scene[0].astype(np.float32)
    alpha = np.random.default_rng(0).uniform(0, 1, image.shape[:2]).astype(np.float32)
    left = (1 - alpha)[..., None]
    expected = left * image + alpha[..., None] * np.float32(layer.brightness)
    assert np.allclose(layer.forward(image, alpha, np.empty_like(image)), expected, atol=1e-6)
    assert np.allclose(layer.backward(image, alpha, np.empty_like(image)), left * image, atol=1e-6)


def test_black_holes_in_renders_hide_no_rain(scene):
    photographs, layers = rained_on(scene)
    seen = learned(scene, float(np.median(layers)))
    holes = np.zeros(seen.shape[:3], bool)
    holes[:, :4, 20:60] = True  # 0.8 %, where nothing has been learned yet
    assert watch(photographs, np.where(holes[..., None], 0, seen)).alpha[0] == pytest.approx(
        watch(photographs, seen).alpha[0], abs=0.015
    )


def told_by_prior(scene, share, shown=None):
    """A layer to which a prior told a share of all views' rain; what it made of the last view, and that view's rain."""
    photographs, layers = rained_on(scene)
    seen = learned(scene, float(np.median(layers))).astype(np.float32)
    layer, found = watch(photographs, seen), None
    for photograph, view, alpha, even in zip(photographs.astype(np.float32), scene, layers, seen, strict=True):
        left = ((1 - alpha) / (1 - share * alpha))[..., None]  # of contrast, by the prior
        found = layer.update_prior(photograph, (0.88 - (0.88 - view) * left).astype(np.float32), even, shown)
    return layer, found, layers[-1]


@pytest.mark.parametrize("share", [0.4, 0.7, 1.0])
def test_how_much_of_the_streaks_a_prior_sees_is_told_by_the_scene(scene, share):
    layer, found, alpha = told_by_prior(scene, share)
    assert layer.prior_gain() == pytest.approx(1 / share, rel=0.15)
    true = alpha - np.median(alpha)
    assert (found * true).sum() / (true**2).sum() == pytest.approx(share, rel=0.15)
    shot, median = layer.shot_alpha[0], layer.prior[0] / layer.prior[1]
    assert layer.alpha_if_it_rains() == pytest.approx((shot**2 * median**2 * layer.prior_gain()) ** 0.25)
    again = RainLayer(100, RainLayerConfig())
    again.load_state_dict(layer.state_dict())
    assert again.alpha_if_it_rains() == layer.alpha_if_it_rains()


def test_a_prior_that_sees_no_rain_takes_away_half_of_it_at_most(scene):
    layer, found, _ = told_by_prior(scene, 0.0)
    assert layer.prior_gain() == 1
    assert np.abs(found).max() < 1e-6
    assert layer.alpha_if_it_rains() == layer.shot_alpha[0] / 2 > 0
    assert RainLayer(100, RainLayerConfig()).prior_gain() == 1


def test_a_prior_is_not_asked_about_hidden_pixels(scene):
    shown = np.ones(SIZE, np.float32)
    shown[:, :60] = 0
    layer, found, _ = told_by_prior(scene, 0.5, shown)
    assert not found[:, :60].any()
    assert found[:, 60:].any()
    assert layer.prior_gain() == pytest.approx(2, rel=0.15)


def test_alpha_stays_once_it_is_settled(scene):
    photographs, layers = rained_on(scene)
    layer = watch(photographs, learned(scene, float(np.median(layers))))
    cover = layer.alpha[0]
    for photograph in photographs:  # by now every streak is learned
        layer.update(photograph, photograph * 0.98, None, iteration=60)
    assert layer.certainty() == 1
    assert layer.alpha[0] == cover


def test_few_updates_say_nothing(scene):
    photographs, layers = rained_on(scene)
    seen = learned(scene, float(np.median(layers))).astype(np.float32)
    layer = RainLayer(100, RainLayerConfig())
    for look in range(24):
        assert look > 15 or layer.certainty() == layer.alpha[0] == 0
        layer.update(photographs[look % COUNT], seen[look % COUNT], None, iteration=30)
    assert layer.certainty() == 1


def test_updates_are_spread_over_the_training():
    layer = RainLayer(1000, RainLayerConfig(updates=50))
    updates = [iteration for iteration in range(1000) if layer.due(iteration)]
    assert 100 <= updates[0] < 118
    assert 50 <= len(updates) <= 54
