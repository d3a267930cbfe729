import cv2
import numpy as np
import pytest

from deraings.rain_model.config import RainfallConfig
from deraings.rain_model.streak_statistics import (
    ANGLES,
    along_line,
    alpha_of_shot_noise,
    directed_skew,
    line_kernel,
    line_powers,
)


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
