from dataclasses import replace

import numpy as np
import pytest
from rained import rained
from scipy.stats import kstest

from hydroviews.rain.patterns import Pattern
from hydroviews.rain.weather import reference
from hydroviews.rain.weather.dark import AmbientPattern, Dark, DarkPattern, darken
from hydroviews.rain.weather.noise import PLANES, NoisePattern, add_noise, standard_normal

PATTERN = Pattern("dark", 1)
AMBIENT = AmbientPattern(stops=1.3, flatness=0.06, tint=(0.97, 1.0, 1.03), pivot=0.2)
NOISE = NoisePattern(shot=5e-4, read=1e-3)


@pytest.fixture
def clean() -> np.ndarray:
    picture = np.random.default_rng(0).random((36, 48, 3)).astype(np.float32)
    picture[:4], picture[4:8] = 0, 1
    return picture


def test_the_composite_is_the_formula(yard, clean):
    rainy, layers, _ = rained(Dark(), DarkPattern(AMBIENT, NOISE), PATTERN, yard, clean=clean)
    chance = np.stack([layers[name] for name in PLANES], axis=-1)
    assert np.abs(rainy - reference.dark(clean, chance, AMBIENT, NOISE)).max() < 1e-6


def test_a_stop_halves_the_light_and_clouds_take_contrast():
    one = replace(AMBIENT, stops=1.0)
    pivot = np.full((1, 3), 0.2, np.float32)
    assert darken(pivot, one) == pytest.approx(np.array([[0.097, 0.1, 0.103]]), rel=1e-5)
    low, high = darken(0.25 * pivot, one), darken(4 * pivot, one)
    assert (high / low)[0] == pytest.approx([16 ** (1 / 1.06)] * 3, rel=1e-4)


def test_noise_is_another_in_every_view_and_channel(yard):
    drawn = DarkPattern(AMBIENT, NOISE)
    views = [rained(Dark(), drawn, PATTERN, yard, view).layers for view in yard.views[:2]]
    planes = [layers[name].ravel() for layers in views for name in PLANES]
    assert np.abs(np.corrcoef(planes) - np.eye(len(planes))).max() < 0.1


def test_chance_is_normal_and_noise_grows_with_light():
    chance = standard_normal(np.random.default_rng(3), (3, 300, 200))
    assert kstest(chance.ravel(), "norm").pvalue > 0.01
    layers = dict(zip(PLANES, chance, strict=True))
    for level in (0.0, 0.05, 0.8):
        light = np.full((300, 200, 3), level, np.float32)
        noisy = add_noise(light, layers, NOISE).astype(np.float64)
        assert noisy.std() == pytest.approx(np.sqrt(NOISE.shot * level + NOISE.read**2), rel=0.01)
        assert noisy.mean() == pytest.approx(level, abs=2e-4)
