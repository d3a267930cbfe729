import numpy as np
import pytest
from wet import HEIGHT, WIDTH, photograph

from hydroviews.pairs.recipes import Pane, compressed, draw_lines, draw_mist, draw_pane
from hydroviews.scene.images import to_linear, to_srgb
from hydroviews.scene.seeds import generator

PICTURE = photograph().astype(np.float32) / 255


@pytest.mark.parametrize("linear", [True, False])
def test_mist_is_mixed_in_linear_light_or_in_encoded_values(linear):
    veil, light = np.full((HEIGHT, WIDTH), 0.3, np.float32), np.array([0.9, 0.6, 0.5], np.float32)
    pane = Pane(veil, light, linear)
    expected = to_srgb(0.7 * to_linear(PICTURE) + 0.3 * light) if linear else 0.7 * PICTURE + 0.3 * light
    np.testing.assert_allclose(pane.over(PICTURE), expected, atol=1e-6)
    assert np.isnan(pane.mist()).any() == (not linear)
    np.testing.assert_allclose(Pane(0 * veil, light, linear).over(PICTURE), PICTURE, atol=1e-5)


def test_mist_is_as_thick_as_asked_for_and_of_many_forms():
    panes = [draw_mist(generator(seed), 96, 64, 0.4) for seed in range(30)]
    assert all(0 <= pane.veil.min() <= pane.veil.max() <= 0.4 + 1e-6 for pane in panes)
    spread = [float(pane.veil.std()) for pane in panes]
    assert min(spread) < 0.04
    assert max(spread) > 0.08
    assert {pane.linear for pane in panes} == {True, False}
    casts = [float(pane.light.max() / pane.light.min()) for pane in panes]
    assert min(casts) < 1.05
    assert max(casts) > 1.15


def test_drops_show_their_surroundings_upside_down():
    cover, source = np.zeros((HEIGHT, WIDTH), np.float32), np.zeros((HEIGHT, WIDTH, 2), np.float32)
    cover[20:40, 30:50] = 1
    source[..., 0], source[..., 1] = np.meshgrid(np.arange(WIDTH), 63 - np.arange(HEIGHT))
    nothing = np.zeros_like(cover)
    pane = Pane(nothing, np.ones(3, np.float32), False, cover, source, blur=0.1)
    rainy = pane.over(PICTURE)
    np.testing.assert_allclose(rainy[25, 35], PICTURE[38, 35], atol=1e-5)
    np.testing.assert_allclose(rainy[:20], PICTURE[:20], atol=1e-5)


def test_a_pane_for_half_the_size_does_the_same():
    pane = draw_pane(generator(3), 96, 64, 0.3)
    assert 0.01 < (pane.drops > 0.3).mean() < 0.4
    smooth = np.full((64, 96, 3), 0.3, np.float32)
    smooth[:32] = 0.6
    halves = lambda picture: picture.reshape(32, 2, 48, 2, 3).mean((1, 3))  # noqa: E731
    apart = np.abs(pane.half().over(halves(smooth)) - halves(pane.over(smooth)))
    assert apart.mean() < 0.02


def test_streaks_are_of_all_strengths_and_companions_have_others():
    falls = [draw_lines(generator(seed, "lines"), 96, 64) for seed in range(20)]
    rain = [float(np.abs(fall.over(PICTURE, fall.layers[0]) - PICTURE).mean()) for fall in falls]
    assert min(rain) < 0.03
    assert max(rain) > 0.08
    grey = np.full((4, 32, 48, 3), 0.3, np.float32)
    seen = falls[0].over_all(grey, generator(1))
    assert seen.shape == grey.shape
    assert np.abs(seen[0] - seen[1]).max() > 0.05
    assert falls[0].over_all(grey[:0], generator(1)).shape == (0, 32, 48, 3)


def test_stored_pictures_lose_a_little():
    errors = [float(np.abs(compressed(PICTURE, quality) - PICTURE).mean()) for quality in (95, 60)]
    assert 0 < errors[0] < errors[1] < 0.05
