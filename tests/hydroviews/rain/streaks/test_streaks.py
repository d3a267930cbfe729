import numpy as np
import pytest

from hydroviews.rain.streaks import reference as streaks_reference
from hydroviews.rain.streaks.convolution import convolve
from hydroviews.rain.streaks.recipe import (
    GRADES,
    StreakPattern,
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


@pytest.mark.parametrize("n", [100, 170.5, 700])
def test_seed_density_is_n_over_25600(n):
    counts = [int((noise(n, 400, 300, generator(seed)) > 0).sum()) for seed in range(20)]
    pixels, expected = 300 * 400, n / 25600
    standard_error = np.sqrt(expected * (1 - expected) / (20 * pixels))
    assert abs(np.mean(counts) / pixels - expected) < 4 * standard_error
    assert 0.5 < np.std(counts) / np.sqrt(expected * (1 - expected) * pixels) < 1.6  # of a binomial's own


@pytest.mark.parametrize("n", [-1, 25601])
def test_impossible_densities_are_refused(n):
    with pytest.raises(ValueError, match="expected"):
        draw_seeds(n, 4, 4, generator(0))


@pytest.mark.parametrize(("length", "width"), [(0, 3), (100, 3), (20, 4), (20, 0)])
def test_impossible_lengths_and_even_widths_are_refused(length, width):
    with pytest.raises(ValueError, match="expected"):
        kernel(length, 90, width)


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


def test_layer_fills_its_range_and_small_images_are_averaged_down():
    pattern = StreakPattern(200, 30, 80, 5)
    large = streak_layer(pattern, 800, 600, generator(1))
    assert large.min() == 0
    assert large.max() == 1
    assert supersampling(800, 600) == 1
    assert supersampling(320, 240) == 3
    small = streak_layer(pattern, 400, 300, generator(1))
    assert np.allclose(small, large.reshape(300, 2, 400, 2).mean((1, 3)), atol=1e-6)


@pytest.mark.parametrize("grade", [None, 0, 1, 2])
def test_patterns_stay_in_the_published_ranges_and_depend_on_the_seed(grade):
    drawn = [draw_pattern(generator(seed, "scene", "streak", 0), *[grade] * (grade is not None)) for seed in range(200)]
    n, length = ((100, 300), (20, 40)) if grade is None else (GRADES[grade].n, GRADES[grade].length)
    widths = {3, 5, 7} if grade is None else set(GRADES[grade].widths)
    assert all(n[0] <= p.n <= n[1] and length[0] <= p.length <= length[1] and 40 <= p.angle <= 120 for p in drawn)
    assert {p.width for p in drawn} == widths <= {3, 5, 7}
    assert 100 <= n[0] < n[1] <= 300
    assert len(set(drawn)) == 200
