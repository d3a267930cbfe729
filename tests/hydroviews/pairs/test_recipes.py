import numpy as np
import pytest
from wet import HEIGHT, WIDTH, photograph

from hydroviews.pairs.camera import noisy
from hydroviews.pairs.recipes.compositing import ENCODED, LINEAR, Space
from hydroviews.pairs.recipes.lines import draw_lines
from hydroviews.pairs.recipes.panes import Pane, draw_pane
from hydroviews.scene.images import to_linear, to_srgb
from hydroviews.scene.seeds import generator

PICTURE = photograph().astype(np.float32) / 255
LIGHT = np.array([0.9, 0.6, 0.5], np.float32)


@pytest.mark.parametrize("space", [LINEAR, ENCODED, Space(1.7)])
def test_mist_is_mixed_in_any_space(space):
    veil = np.full((HEIGHT, WIDTH), 0.3, np.float32)
    there, back = {
        LINEAR: (to_linear, to_srgb),
        ENCODED: (np.copy, np.copy),
        Space(1.7): (lambda v: v**1.7, lambda v: v ** (1 / 1.7)),
    }[space]
    pane = Pane(veil, LIGHT, space)
    np.testing.assert_allclose(pane.over(PICTURE), back(0.7 * there(PICTURE) + 0.3 * LIGHT), atol=1e-5)
    assert np.isnan(pane.mist()).any() == (space != LINEAR)
    np.testing.assert_allclose(Pane(0 * veil, LIGHT, space).over(PICTURE), PICTURE, atol=1e-5)
    assert not Pane(0 * veil, LIGHT, space).mist().any()


def test_the_scene_behind_mist_is_less_sharp():
    veil = np.zeros((HEIGHT, WIDTH), np.float32)
    veil[:, 48:] = 0.5
    seen = Pane(veil, 0 * LIGHT, ENCODED, blur=0.05).over(PICTURE)
    np.testing.assert_array_equal(seen[:, :48], PICTURE[:, :48])
    sharp = Pane(veil, 0 * LIGHT, ENCODED).over(PICTURE)
    assert seen[:, 48:].std() < 0.8 * sharp[:, 48:].std()


def test_a_pane_for_half_the_size_does_the_same():
    smooth = np.full((64, 96, 3), 0.3, np.float32)
    smooth[:32] = 0.6
    halves = lambda picture: picture.reshape(32, 2, 48, 2, 3).mean((1, 3))  # noqa: E731
    for seed in range(12):
        pane = draw_pane(generator(seed), 96, 64)
        harm = np.abs(pane.over(smooth) - smooth).mean()
        apart = np.abs(pane.half().over(halves(smooth)) - halves(pane.over(smooth)))
        assert apart.mean() < 0.15 * harm + 0.005


def test_streaks_are_of_all_strengths_and_companions_have_others():
    falls = [draw_lines(generator(seed, "lines"), 96, 64) for seed in range(40)]
    rain = [float(np.abs(fall.over(PICTURE, fall.layers[0]) - PICTURE).mean()) for fall in falls]
    assert min(rain) < 0.02
    assert max(rain) > 0.08
    assert all(0 <= fall.layers.min() <= fall.layers.max() <= 1 for fall in falls)
    grey = np.full((4, 32, 48, 3), 0.3, np.float32)
    seen = falls[0].over_all(grey, generator(1))
    assert seen.shape == grey.shape
    assert np.abs(seen[0] - seen[1]).max() > 0.05
    assert falls[0].over_all(grey[:0], generator(1)).shape == (0, 32, 48, 3)


def test_noise_of_a_sensor_is_as_strong_as_asked_for():
    grey = np.full((64, 96, 3), 0.5, np.float32)
    noise = noisy(grey, 0.01, generator(0)) - grey
    assert noise.std() == pytest.approx(0.01, rel=0.05)
    assert abs(noise.mean()) < 5e-4
    assert noisy(np.ones_like(grey), 0.01, generator(0)).max() == 1
