import cv2
import numpy as np
import panorama
import pytest

from deraings.rain_model.rain_layer import ANGLES, FallingConfig, FallingRain, directed_skew, line_kernel, line_powers
from hydroviews.rain.streaks.recipe import StreakPattern, composite, streak_layer

COUNT, SIZE = 10, (121, 160)
PATTERN = StreakPattern(n=200, length=30, angle=75, width=5)


def rained_on(scene, brightness=0.88):
    """The views with the paper's streaks, and the streaks' layers."""
    rng = np.random.default_rng(7)
    layers = [streak_layer(PATTERN, SIZE[1], SIZE[0], rng) for _ in scene]
    return np.stack([composite(v, s, brightness) for v, s in zip(scene, layers, strict=True)]), np.stack(layers)


def watch(photographs, seen, weights=None):
    falling = FallingRain(100, FallingConfig(memory=1000, fewest=0))
    for photograph, expected in zip(photographs, seen, strict=True):
        falling.observe(photograph, expected.astype(np.float32), weights, iteration=30)
    return falling


@pytest.fixture(scope="module")
def scene():
    return panorama.views_of(panorama.paint(size=(250, 400)), COUNT, size=SIZE)


def learned(scene, cover, brightness=0.88):
    """The scene as it is learned through rain of that median cover, with an error."""
    error = 0.02 * np.random.default_rng(3).standard_normal(scene.shape)
    return scene * (1 - cover) + brightness * cover + error


def test_more_looks_than_are_remembered_cannot_be_asked_for():
    with pytest.raises(ValueError, match="could never be believed"):
        FallingConfig(memory=14)


def test_the_median_cover_is_found(scene):
    photographs, layers = rained_on(scene)
    cover = float(np.median(layers))
    falling = watch(photographs, learned(scene, cover))
    assert falling.certainty() == 1
    assert falling.cover[0] == pytest.approx(cover, abs=0.05)
    assert abs(falling.angle() - PATTERN.angle) <= 15


@pytest.mark.parametrize("fog", [0.0, 0.5])
def test_it_does_not_rain_in_dry_views_nor_in_fog(scene, fog):
    pale = scene * (1 - fog) + 0.7 * fog
    falling = watch(pale, learned(pale, 0))
    assert falling.certainty() == 0
    assert falling.cover[0] == 0


def test_rain_before_fog_is_not_taken_for_the_fog(scene):
    pale = scene * 0.5 + 0.35
    photographs, layers = rained_on(pale)
    cover = float(np.median(layers))
    falling = watch(photographs, learned(pale, cover))
    assert falling.cover[0] == pytest.approx(cover, abs=0.08)


def test_pixels_without_weight_are_not_looked_at(scene):
    photographs, _ = rained_on(scene)
    falling = watch(photographs, learned(scene, 0.1), np.zeros(scene.shape[1:3], np.float32))
    assert falling.cover[0] == 0


def test_more_light_in_one_direction_is_skew():
    rng = np.random.default_rng(0)
    seeds = (rng.uniform(size=(80, 80)) > 0.98).astype(np.float32)
    streaks = cv2.filter2D(seeds, -1, 7 * line_kernel(7, 60))
    noise = 0.2 * rng.standard_normal(seeds.shape).astype(np.float32)
    dry, wet = (directed_skew(line_powers(picture, 7 / 80, None)) for picture in (noise, noise + streaks))
    assert dry < 0.1
    assert wet > 0.3


def test_drops_that_ran_a_little_are_no_rain():
    rng = np.random.default_rng(0)
    seeds = (rng.uniform(size=(240, 240)) > 0.998).astype(np.float32)
    drops = 20 * cv2.GaussianBlur(seeds, (0, 0), sigmaX=2.0, sigmaY=2.4)
    powers = line_powers(drops + 0.2 * rng.standard_normal(seeds.shape).astype(np.float32), 9 / 240, None)
    skews = powers[:, 2] / powers[:, 1] ** 1.5
    assert skews.max() - np.median(skews) > FallingConfig().dry
    assert directed_skew(powers) < FallingConfig().dry


def test_a_witness_of_the_even_cover_is_believed_by_half():
    falling = FallingRain(100, FallingConfig())
    for _ in range(3):
        falling.hear(0.1)
    assert falling.even() == pytest.approx(0.05)
    falling.hear(-0.5)
    assert falling.even() == 0
    again = FallingRain(100, FallingConfig())
    again.load_state_dict(falling.state_dict())
    assert again.even() == falling.even()
    assert again.heard[1] == 4


def test_the_cover_stays_once_it_is_settled(scene):
    photographs, layers = rained_on(scene)
    falling = watch(photographs, learned(scene, float(np.median(layers))))
    cover = falling.cover[0]
    for photograph in photographs:  # by now every streak is learned
        falling.observe(photograph, photograph * 0.98, None, iteration=60)
    assert falling.certainty() == 1
    assert falling.cover[0] == cover


def test_few_looks_say_nothing(scene):
    photographs, layers = rained_on(scene)
    seen = learned(scene, float(np.median(layers))).astype(np.float32)
    falling = FallingRain(100, FallingConfig())
    for look in range(24):
        assert look > 15 or falling.certainty() == falling.cover[0] == 0
        falling.observe(photographs[look % COUNT], seen[look % COUNT], None, iteration=30)
    assert falling.certainty() == 1


def test_looks_are_spread_over_the_training():
    falling = FallingRain(1000, FallingConfig(looks=50))
    looks = [iteration for iteration in range(1000) if falling.due(iteration)]
    assert 100 <= looks[0] < 118
    assert 50 <= len(looks) <= 54


@pytest.mark.parametrize("angle", ANGLES)
def test_a_line_kernel_sums_to_one_and_turns_counter_clockwise(angle):
    kernel = line_kernel(9, angle)
    assert kernel.sum() == pytest.approx(1, abs=1e-5)
    ys, xs = np.mgrid[4:-5:-1, -4:5]
    along = (kernel * (xs * np.cos(np.radians(angle)) + ys * np.sin(np.radians(angle))) ** 2).sum()
    across = (kernel * (-xs * np.sin(np.radians(angle)) + ys * np.cos(np.radians(angle))) ** 2).sum()
    assert along > 10 * across
