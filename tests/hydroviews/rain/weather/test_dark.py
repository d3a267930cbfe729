import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import kstest

from hydroviews.rain.effect import fall
from hydroviews.rain.patterns import Pattern
from hydroviews.rain.severity import wanted_harm
from hydroviews.rain.weather import reference
from hydroviews.rain.weather.dark import AmbientPattern, Dark, DarkPattern, darken
from hydroviews.rain.weather.noise import PLANES, NoisePattern, add_noise, standard_normal
from hydroviews.rain.weather.severity import LOSS

PATTERN = Pattern("dark", 1)
AMBIENT = AmbientPattern(stops=1.3, flatness=0.06, tint=(0.97, 1.0, 1.03), pivot=0.2)
NOISE = NoisePattern(shot=5e-4, read=1e-3)
SILENT = NoisePattern(shot=0.0, read=0.0)


@pytest.fixture
def clean() -> np.ndarray:
    picture = np.random.default_rng(0).random((36, 48, 3)).astype(np.float32)
    picture[:4], picture[4:8] = 0, 1
    return picture


def taken(drawn: DarkPattern, clean, statistics, view: int = 0):
    rain = Dark().place(drawn, PATTERN, statistics)
    parameters = json.loads(json.dumps(rain.parameters))  # as verification reads them
    layers = fall(rain.prepare(statistics.views[view].camera, None), clean, statistics.views[view])
    return Dark().composite(parameters, clean, layers), layers


def test_the_composite_is_the_formula(yard, clean):
    rainy, layers = taken(DarkPattern(AMBIENT, NOISE), clean, yard)
    chance = np.stack([layers[name] for name in PLANES], axis=-1)
    assert np.abs(rainy - reference.dark(clean, chance, AMBIENT, NOISE)).max() < 1e-6


def test_a_stop_halves_the_light_and_clouds_take_contrast():
    one = replace(AMBIENT, stops=1.0)
    pivot = np.full((1, 3), 0.2, np.float32)
    assert darken(pivot, one) == pytest.approx(np.array([[0.097, 0.1, 0.103]]), rel=1e-5)
    low, high = darken(0.25 * pivot, one), darken(4 * pivot, one)
    assert (high / low)[0] == pytest.approx([16 ** (1 / 1.06)] * 3, rel=1e-4)


def test_noise_is_the_seeds_and_another_in_every_view(yard, clean):
    layers = [taken(DarkPattern(AMBIENT, NOISE), clean, yard, view)[1] for view in (0, 0, 1)]
    other = taken(DarkPattern(AMBIENT, NOISE), clean, replace(yard, seed=1))[1]
    for name in PLANES:
        assert np.array_equal(layers[0][name], layers[1][name])
        assert abs(np.corrcoef(layers[0][name].ravel(), layers[2][name].ravel())[0, 1]) < 0.1
        assert not np.array_equal(layers[0][name], other[name])
    channels = [layers[0][name].ravel() for name in PLANES]
    assert abs(np.corrcoef(channels)[0, 1]) < 0.1


def test_chance_is_normal_and_noise_grows_with_light():
    chance = standard_normal(np.random.default_rng(3), (3, 300, 200))
    assert kstest(chance.ravel(), "norm").pvalue > 0.01
    layers = dict(zip(PLANES, chance, strict=True))
    for level in (0.0, 0.05, 0.8):
        light = np.full((300, 200, 3), level, np.float32)
        noisy = add_noise(light, layers, NOISE).astype(np.float64)
        assert noisy.std() == pytest.approx(np.sqrt(NOISE.shot * level + NOISE.read**2), rel=0.01)
        assert noisy.mean() == pytest.approx(level, abs=2e-4)


@pytest.mark.parametrize("index", [0, 1, 2])
def test_a_grade_does_its_harm(yard, index):
    pattern = Pattern("dark", index)
    drawn = Dark().draw(pattern, yard)
    pairs = [(taken(replace(drawn, noise=SILENT), sample, yard)[0], sample) for sample in yard.samples]
    found = np.mean([np.mean((rainy - sample) ** 2) for rainy, sample in pairs])
    assert found == pytest.approx(wanted_harm(LOSS["dark"][pattern.grade], yard), rel=0.02)
