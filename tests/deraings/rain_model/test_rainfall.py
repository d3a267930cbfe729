"""Falling rain: what photographs show of it along lines, and how much of it there is."""

import cv2
import numpy as np
import panorama
import pytest
from pretended_network import PretendedNetwork

from deraings.rain_model.config import RainfallConfig
from deraings.rain_model.rainfall import MIN_UPDATES, Observation, Rainfall, alpha_between
from deraings.rain_model.streak_statistics import (
    ANGLES,
    along_line,
    alpha_of_shot_noise,
    directed_skew,
    line_kernel,
    line_powers,
)
from deraings.rain_model.streaks import MIN_CONTRAST
from hydroviews.rain.streaks.recipe import StreakPattern, composite, streak_layer

COUNT, SIZE, BETA, STEPS = 10, (121, 160), 0.88, 100
PATTERN = StreakPattern(n=200, length=30, angle=75, width=5)
CONFIG = RainfallConfig(memory=1000)


@pytest.fixture(scope="module")
def scene():
    return panorama.views_of(panorama.paint(size=(250, 400)), COUNT, size=SIZE)


def rained_on(scene):
    """The views with the paper's streaks, the streaks' layers, and the scene as it is learned through such rain."""
    rng = np.random.default_rng(7)
    layers = np.stack([streak_layer(PATTERN, SIZE[1], SIZE[0], rng) for _ in scene])
    photographs = [composite(view, layer, BETA) for view, layer in zip(scene, layers, strict=True)]
    return np.stack(photographs).astype(np.float32), layers, learned(scene, float(np.median(layers)))


def learned(scene, cover):
    """The scene as it is learned through rain of that median cover, with an error."""
    error = 0.02 * np.random.default_rng(3).standard_normal(scene.shape)
    return (scene * (1 - cover) + BETA * cover + error).astype(np.float32)


def watch(photographs, seen, weights=None, network=None, rounds=2):
    """Rain that has been looked for in all views, some times."""
    rain = Rainfall([SIZE] * COUNT, STEPS, 0, CONFIG, network)
    for _ in range(rounds):
        for view in range(COUNT):
            rain.update(Observation(photographs[view], None, None, weights), seen[view], view, iteration=30)
    return rain


@pytest.mark.parametrize(("fog", "error"), [(0.0, 0.05), (0.5, 0.08)])
def test_the_median_alpha_is_found_and_fog_is_not_taken_for_it(scene, fog, error):
    photographs, layers, seen = rained_on(scene * (1 - fog) + 0.7 * fog)
    rain = watch(photographs, seen)
    assert rain.certainty() == 1
    assert rain.even_alpha == pytest.approx(float(np.median(layers)), abs=error)
    assert abs(rain.angle() - PATTERN.angle) <= 15


@pytest.mark.parametrize("fog", [0.0, 0.5])
def test_it_does_not_rain_in_dry_views_nor_in_fog(scene, fog):
    pale = (scene * (1 - fog) + 0.7 * fog).astype(np.float32)
    rain = watch(pale, learned(pale, 0))
    assert rain.certainty() == rain.even_alpha == 0
    assert rain.rain_alpha(0, SIZE) is None


def test_pixels_without_weight_are_not_looked_at(scene):
    photographs, _, _ = rained_on(scene)
    rain = watch(photographs, learned(scene, 0.1), np.zeros(SIZE, np.float32))
    assert rain.even_alpha == 0
    assert not rain.powers.any()


def test_a_view_that_is_nearly_all_light_tells_nothing(scene):
    photographs, _, seen = rained_on(scene)
    photographs[:, 4:], seen[:, 4:] = 0.9, 0.8  # less than a twentieth is left
    assert not watch(photographs, seen).powers.any()


def test_few_updates_say_nothing(scene):
    photographs, _, seen = rained_on(scene)
    rain = Rainfall([SIZE] * COUNT, STEPS, 0, RainfallConfig())
    for update in range(24):
        assert rain.powers[0, 0] >= MIN_UPDATES or rain.certainty() == rain.even_alpha == 0
        view = update % COUNT
        rain.update(Observation(photographs[view], None, None, None), seen[view], view, iteration=30)
    assert rain.certainty() == 1
    assert rain.even_alpha > 0


def test_alpha_stays_once_half_of_the_training_is_over(scene):
    photographs, _, seen = rained_on(scene)
    rain = watch(photographs, seen)
    cover = rain.even_alpha
    for view, photograph in enumerate(photographs):  # by now every streak is learned
        rain.update(Observation(photograph, None, None, None), photograph * np.float32(0.98), view, iteration=60)
    assert rain.certainty() == 1
    assert rain.even_alpha == cover


def test_updates_are_spread_over_the_training_from_its_start_on():
    rain = Rainfall([SIZE], 1000, 100, RainfallConfig(updates=50))
    updates = [iteration for iteration in range(1000) if rain.due(0, SIZE, iteration)]
    assert 100 <= updates[0] < 118
    assert 50 <= len(updates) <= 54
    assert not any(rain.due(0, (60, 80), iteration) for iteration in range(1000))  # small views hide streaks


def seen_by_a_network(scene, share):
    """Rain, of which a network takes a share off all views."""
    photographs, layers, seen = rained_on(scene)
    left = ((1 - layers) / (1 - share * layers))[..., None]  # of contrast
    network = PretendedNetwork(BETA - (BETA - scene) * left)
    return watch(photographs, seen, network=network, rounds=4), network, layers


@pytest.mark.parametrize("share", [0.4, 0.7, 1.0])
def test_how_much_of_the_streaks_a_network_sees_is_told_by_the_scene(scene, share):
    rain, network, layers = seen_by_a_network(scene, share)
    assert network.read
    products, squares = rain.predicted_along
    assert products / squares == pytest.approx(1 / share, rel=0.2)
    median = rain.predicted[0] / rain.predicted[1]
    expected = np.sqrt(rain.shot_alpha[0] * median * np.sqrt(products / squares))
    assert rain.even_alpha == pytest.approx(expected)
    assert rain.even_alpha == pytest.approx(np.median(layers), abs=0.07)


def test_a_network_that_sees_no_rain_takes_away_half_of_it_at_most(scene):
    rain, _, _ = seen_by_a_network(scene, 0.0)
    assert rain.even_alpha == rain.shot_alpha[0] / 2 > 0


def test_a_network_is_not_asked_where_it_does_not_rain(scene):
    network = PretendedNetwork(scene)
    watch(scene, learned(scene, 0), network=network)
    assert not network.read


def test_a_dry_picture_tells_alpha(scene):
    covers = rained_on(scene)[1][0]
    dark = np.minimum(scene[0], 0.5).astype(np.float32)
    rainy = composite(dark, covers, BETA).astype(np.float32)
    found = alpha_between(rainy, dark, BETA)
    assert np.abs(found - covers).max() < 0.08 * covers.max()
    contrast = np.maximum(BETA - dark.astype(np.float64), 0)
    expected = ((rainy - dark) * contrast).sum(axis=2) / ((contrast**2).sum(axis=2) + MIN_CONTRAST**2)
    assert found == pytest.approx(expected, abs=1e-4)
    white = np.ones_like(dark)
    assert not alpha_between(dark, dark, BETA).any()
    assert not alpha_between(white, white, BETA).any()


def test_more_light_in_one_direction_is_skew_and_dark_specks_are_not():
    rng = np.random.default_rng(0)
    seeds = (rng.uniform(size=(80, 80)) > 0.98).astype(np.float32)
    streaks = cv2.filter2D(seeds, -1, 7 * line_kernel(7, 60))
    noise = 0.2 * rng.standard_normal(seeds.shape).astype(np.float32)
    seen = noise, noise + streaks, noise / 10 - seeds
    dry, wet, dark = (directed_skew(line_powers(picture, 7 / 80, None)) for picture in seen)
    assert dry < 0.1
    assert wet > 0.3
    assert dark == 0


def test_powers_along_lines_are_the_plain_moments():
    rng = np.random.default_rng(1)
    picture = rng.standard_normal((31, 45)).astype(np.float32) ** 3  # with outliers
    clear = rng.uniform(size=picture.shape) > 0.2
    for counted in (None, clear):
        shown = picture if counted is None else np.where(counted, picture, picture[counted].mean())
        for row, angle in zip(line_powers(picture, 5 / 45, counted), ANGLES, strict=True):
            lines = cv2.filter2D(shown, -1, line_kernel(5, angle)) - cv2.blur(shown, (5, 5))
            x = lines.astype(np.float64)[slice(None) if counted is None else counted]
            x = np.clip(x, -4 * x.std(), 4 * x.std())
            assert row == pytest.approx([1, (x**2).mean(), (x**3).mean()], rel=1e-4, abs=1e-5)
    assert not line_powers(picture, 5 / 45, np.zeros(picture.shape, bool)).any()


def test_drops_that_ran_a_little_are_no_rain():
    rng = np.random.default_rng(0)
    seeds = (rng.uniform(size=(240, 240)) > 0.998).astype(np.float32)
    drops = 20 * cv2.GaussianBlur(seeds, (0, 0), sigmaX=2.0, sigmaY=2.4)
    powers = line_powers(drops + 0.2 * rng.standard_normal(seeds.shape).astype(np.float32), 9 / 240, None)
    skews = powers[:, 2] / powers[:, 1] ** 1.5
    assert skews.max() - np.median(skews) > RainfallConfig().dry
    assert directed_skew(powers) < RainfallConfig().dry


@pytest.mark.parametrize(("density", "strength"), [(0.004, 0.15), (0.004, 0.3), (0.015, 0.15), (0.03, 0.1)])
def test_cumulants_say_how_much_rain_there_is(density, strength):
    rng = np.random.default_rng(0)
    powers = 0
    for _ in range(8):
        seeds = rng.poisson(density, (240, 320)).astype(np.float32)
        streak = strength * cv2.GaussianBlur(np.pad(31 * line_kernel(31, 75), 4), (0, 0), 1.0)
        rain = cv2.filter2D(seeds, -1, streak)
        noise = 0.03 * rng.standard_normal(rain.shape).astype(np.float32)
        powers = powers + line_powers(rain - np.median(rain) + noise, 15 / 320, None)
    mean = density * float(streak.sum())
    found = alpha_of_shot_noise(powers)
    assert found / (1 - found) == pytest.approx(mean, rel=0.25)


def test_averages_along_a_line_show_streaks_and_nothing_of_what_is_hidden():
    rng = np.random.default_rng(0)
    streaks = cv2.filter2D((rng.uniform(size=(80, 120)) > 0.995).astype(np.float32), -1, 9 * line_kernel(9, 60))
    clear = np.ones(streaks.shape, bool)
    clear[:, :30] = False
    along, across = (along_line(np.where(clear, streaks, 9), clear, 9 / 120, angle) for angle in (60, 150))
    assert along.shape == (clear.sum(),)
    assert along.var() > 4 * across.var()
    assert np.abs(along).max() < 2


@pytest.mark.parametrize("angle", ANGLES)
def test_a_line_kernel_sums_to_one_and_turns_counter_clockwise(angle):
    kernel = line_kernel(9, angle)
    assert kernel.sum() == pytest.approx(1, abs=1e-5)
    ys, xs = np.mgrid[4:-5:-1, -4:5]
    along = (kernel * (xs * np.cos(np.radians(angle)) + ys * np.sin(np.radians(angle))) ** 2).sum()
    across = (kernel * (-xs * np.sin(np.radians(angle)) + ys * np.cos(np.radians(angle))) ** 2).sum()
    assert along > 10 * across
