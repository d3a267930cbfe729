from dataclasses import replace

import cv2
import numpy as np
import pytest

from hydroviews.rain.streaks import reference as streaks_reference
from hydroviews.rain.streaks.convolution import Seeds, convolve
from hydroviews.rain.streaks.measures import streak_angle
from hydroviews.rain.streaks.recipe import (
    GRADES,
    PRE_BLUR,
    StreakPattern,
    composite,
    draw_pattern,
    draw_seeds,
    kernel,
    noise,
    normalised,
    seed_image,
    streak_layer,
    supersampling,
)
from hydroviews.scene.seeds import generator


@pytest.mark.parametrize("angle", [40, 60, 90, 105, 120])
@pytest.mark.parametrize(("length", "width"), [(20, 3), (30, 5), (40, 7)])
def test_streaks_fall_at_the_angle_asked_for(angle, length, width):
    layer = streak_layer(StreakPattern(200, length, angle, width), 800, 600, generator(0, angle))
    assert abs(streak_angle(layer) - angle) < 3


@pytest.mark.parametrize("n", [100, 170.5, 300, 700])
def test_seed_density_is_n_over_25600(n):
    pixels = 20 * 300 * 400
    drawn = [noise(n, 400, 300, generator(seed)) for seed in range(20)]
    hits = sum(int((picture > 0).sum()) for picture in drawn)
    expected = n / 25600
    standard_error = np.sqrt(expected * (1 - expected) / pixels)
    assert abs(hits / pixels - expected) < 4 * standard_error
    counts = [int((picture > 0).sum()) for picture in drawn]
    spread = np.std(counts) / np.sqrt(expected * (1 - expected) * 300 * 400)  # of a binomial's own
    assert 0.5 < spread < 1.6


def test_seeds_are_spread_evenly_in_place_and_value():
    picture = np.concatenate([noise(300, 400, 300, generator(seed)) for seed in range(20)])
    rows, columns = np.nonzero(picture)
    values = picture[rows, columns]
    assert values.min() >= 253
    assert values.max() <= 256
    for quantity, low, high in ((rows % 300, 0, 299), (columns, 0, 399), (values, 253, 256)):
        middle, deviation = (low + high) / 2, (high - low) / np.sqrt(12)
        assert abs(quantity.mean() - middle) < 4 * deviation / np.sqrt(len(quantity))
    assert abs(np.corrcoef(rows % 300, columns)[0, 1]) < 4 / np.sqrt(len(rows))


@pytest.mark.parametrize(("fewer", "more"), [(100, 110), (299, 301), (10, 900)])
def test_more_noise_keeps_the_seeds_there_were(fewer, more):
    few, many = (noise(n, 200, 150, generator(5)) for n in (fewer, more))
    assert (many > 0).sum() > (few > 0).sum()
    assert np.array_equal(many[few > 0], few[few > 0])


def test_cover_grows_smoothly_with_noise():
    pattern = StreakPattern(150, 30, 80, 5)
    covers = [streak_layer(replace(pattern, n=n), 200, 150, generator(0)).mean() for n in (100, 150, 151, 300, 450)]
    assert covers == sorted(covers)
    assert covers[2] - covers[1] < 0.02 * covers[1]


@pytest.mark.parametrize("n", [-1, 25601])
def test_impossible_noise_is_refused(n):
    with pytest.raises(ValueError, match="expected 0 to 25600"):
        draw_seeds(n, 4, 4, generator(0))


def test_no_noise_is_no_rain_and_all_noise_is_rain_everywhere():
    assert streak_layer(StreakPattern(0, 30, 80, 5), 60, 40, generator(0)).max() == 0
    assert (noise(25600, 60, 40, generator(0)) > 0).all()


@pytest.mark.parametrize("size", [(1, 1), (17, 15), (33, 1), (1, 50), (120, 90)])
@pytest.mark.parametrize(("length", "angle", "width"), [(20, 40, 3), (21, 90, 5), (40, 120, 7), (1, 90, 1)])
def test_drawing_is_the_direct_convolution(size, length, angle, width):
    seeds = draw_seeds(900, *size, generator(3))
    image = seed_image(kernel(length, angle, width))
    ours = normalised(convolve(seeds, image, *size))
    exact = streaks_reference.drawing(noise(900, *size, generator(3)), length, angle, width)
    assert np.abs(ours - exact).max() < 1e-6
    assert len(seeds.values) > 0 or size == (1, 1)


def test_a_seed_on_the_border_is_mirrored_as_opencv_mirrors_it():
    seeds = np.zeros((30, 40), np.float32)
    for row, column in ((0, 0), (29, 39), (0, 20), (15, 39), (1, 38)):
        seeds[row, column] = 255
    k = kernel(31, 60, 5)
    places = np.argwhere(seeds)
    ours = convolve(Seeds(places[:, 0], places[:, 1], seeds[seeds > 0]), seed_image(k), 40, 30)
    theirs = cv2.filter2D(cv2.filter2D(seeds.astype(np.float64), -1, PRE_BLUR), -1, k)
    assert np.abs(ours - theirs).max() < 1e-6 * theirs.max()


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


@pytest.mark.parametrize("grade", [0, 1, 2])
def test_grades_are_parts_of_the_published_ranges(grade):
    ranges = GRADES[grade]
    patterns = [draw_pattern(generator(seed, "graded"), grade) for seed in range(100)]
    assert all(ranges.n[0] <= p.n <= ranges.n[1] and ranges.length[0] <= p.length <= ranges.length[1] for p in patterns)
    assert {p.width for p in patterns} == set(ranges.widths) <= {3, 5, 7}
    assert 100 <= ranges.n[0] < ranges.n[1] <= 300
    assert all(40 <= p.angle <= 120 for p in patterns)


@pytest.mark.parametrize(("width", "height"), [(1, 1), (17, 15), (33, 1), (5, 31)])
def test_tiny_images(width, height):
    layer = streak_layer(StreakPattern(100, 40, 90, 7), width, height, generator(0))
    assert layer.shape == (height, width)
    assert np.isfinite(layer).all()


@pytest.mark.parametrize(("length", "width"), [(0, 3), (100, 3), (20, 4), (20, 0)])
def test_impossible_kernels_are_refused(length, width):
    with pytest.raises(ValueError, match="expected"):
        kernel(length, 90, width)
