import cv2
import numpy as np
import pytest

from hydroviews.rain.seeds import generator
from hydroviews.rain.streaks import (
    StreakPattern,
    composite,
    draw_pattern,
    kernel,
    noise,
    streak_layer,
    supersampling,
)


def measured_angle(layer: np.ndarray) -> float:
    """Direction of the streaks by the structure tensor, degrees counter-clockwise from +x, in [0, 180)."""
    gx, gy = cv2.Sobel(layer, cv2.CV_64F, 1, 0), cv2.Sobel(layer, cv2.CV_64F, 0, 1)
    across = 0.5 * np.arctan2(2 * (gx * gy).sum(), (gx * gx - gy * gy).sum())  # y runs down
    return float((90 - np.degrees(across)) % 180)


@pytest.mark.parametrize("angle", [40, 60, 90, 105, 120])
@pytest.mark.parametrize(("length", "width"), [(20, 3), (30, 5), (40, 7)])
def test_streaks_fall_at_the_angle_asked_for(angle, length, width):
    layer = streak_layer(StreakPattern(200, length, angle, width), 800, 600, generator(0, angle))
    assert abs(measured_angle(layer) - angle) < 3


@pytest.mark.parametrize("n", [100, 300])
def test_seed_density_is_n_over_25600(n):
    pixels = 20 * 300 * 400
    hits = sum(int((noise(n, 400, 300, generator(seed)) > 0).sum()) for seed in range(20))
    expected = n / 25600
    standard_error = np.sqrt(expected * (1 - expected) / pixels)
    assert abs(hits / pixels - expected) < 4 * standard_error


def test_convolution_is_exact():
    rng = generator(3)
    seeds, k = noise(300, 60, 40, rng), kernel(21, 70, 5)
    direct = np.zeros_like(seeds, np.float64)
    padded = np.pad(seeds, 10, mode="reflect").astype(np.float64)
    for dy in range(21):
        for dx in range(21):
            direct += k[dy, dx] * padded[dy : dy + 40, dx : dx + 60]
    assert np.abs(cv2.filter2D(seeds, -1, k) - direct).max() < 1e-6 * direct.max()


def test_layer_fills_its_range_and_small_images_are_averaged_down():
    pattern = StreakPattern(200, 30, 80, 5)
    large = streak_layer(pattern, 800, 600, generator(1))
    assert large.min() == 0
    assert large.max() == 1
    assert supersampling(800, 600) == 1
    assert supersampling(320, 240) == 3
    small = streak_layer(pattern, 400, 300, generator(1))
    assert np.allclose(small, large.reshape(300, 2, 400, 2).mean((1, 3)), atol=1e-6)


def test_composite_only_moves_towards_the_rain():
    background = np.linspace(0, 0.7, 48, dtype=np.float32).reshape(4, 4, 3)
    layer = np.full((4, 4), 0.25, np.float32)
    rainy = composite(background, layer, 0.8)
    assert np.allclose(rainy, 0.75 * background + 0.2)
    assert np.array_equal(composite(background, np.zeros((4, 4)), 0.8), background)


def test_patterns_stay_in_the_published_ranges_and_depend_on_the_seed():
    patterns = [draw_pattern(generator(seed, "scene", "streak", 0)) for seed in range(200)]
    assert all(100 <= p.n <= 300 and 20 <= p.length <= 40 and 40 <= p.angle <= 120 for p in patterns)
    assert {p.width for p in patterns} == {3, 5, 7}
    assert len(set(patterns)) == 200
    assert draw_pattern(generator(0, "scene", "streak", 0)) == patterns[0]


@pytest.mark.parametrize(("width", "height"), [(1, 1), (17, 3), (5, 31)])
def test_tiny_images(width, height):
    layer = streak_layer(StreakPattern(100, 40, 90, 7), width, height, generator(0))
    assert layer.shape == (height, width)
    assert np.isfinite(layer).all()


@pytest.mark.parametrize(("length", "width"), [(0, 3), (100, 3), (20, 4), (20, 0)])
def test_impossible_kernels_are_refused(length, width):
    with pytest.raises(ValueError, match="expected"):
        kernel(length, 90, width)
