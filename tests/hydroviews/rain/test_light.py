import numpy as np
import pytest

from hydroviews.rain.light import BRIGHTEST, expand_highlights, rain_light
from hydroviews.scene.images import luminance, to_linear


def picture(encoded: float, width: int = 80, height: int = 60) -> np.ndarray:
    return to_linear(np.full((height, width, 3), encoded, np.float32))


def test_lamps_gain_and_skies_do_not():
    lamp = picture(0.2, 200, 150)
    lamp[40:44, 50:54] = 1
    brighter = expand_highlights(lamp)
    assert brighter.max() == pytest.approx(BRIGHTEST)
    assert np.array_equal(brighter[:30], lamp[:30])
    sky = picture(0.2)
    sky[:30] = 1  # half of the picture
    assert np.array_equal(expand_highlights(sky), sky)


@pytest.mark.parametrize("size", [(80, 60), (1, 1), (33, 1), (400, 20)])
def test_rain_over_an_even_grey_shows_that_grey(size):
    grey = picture(0.5, *size)
    assert np.allclose(rain_light(grey), grey, rtol=1e-5)


def test_rain_follows_its_surroundings_and_not_its_pixel():
    halves = picture(0.1, 160, 120)
    halves[:, 80:] = to_linear(np.float32(0.8))
    light = luminance(rain_light(halves))
    halves[60, 20] = 0.2
    assert luminance(rain_light(halves))[60, 20] == pytest.approx(light[60, 20], rel=0.05)
    assert (np.diff(light[60, ::8]) >= 0).all()
    assert light[:, 150].mean() > 4 * light[:, 5].mean()


def test_rain_is_at_least_as_bright_as_its_mean_surroundings_and_proportional():
    noisy = to_linear(np.random.default_rng(1).uniform(0, 0.6, (60, 80, 3)))
    light = rain_light(noisy)
    assert light.mean() > noisy.mean()
    assert light.max() < noisy.max()
    assert np.allclose(rain_light(2 * noisy), 2 * light, rtol=1e-4)


def test_rain_is_less_colourful_than_its_surroundings_but_a_lamp_keeps_its_colour():
    red = np.full((40, 60, 3), (0.5, 0.1, 0.1), np.float32)
    shown = rain_light(red)[20, 30]
    assert 1 < shown[0] / shown[1] < 5
    lamp = np.zeros((40, 60, 3), np.float32)
    lamp[20, 30] = (8.0, 4.0, 1.0)
    near = rain_light(lamp)[20, 36]
    assert near[0] > near[1] > near[2]
