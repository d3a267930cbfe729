import numpy as np
import pytest
from wet import HEIGHT, WIDTH, lens, photograph

from hydroviews.pairs.camera import noisy
from hydroviews.pairs.recipes.compositing import ENCODED, LINEAR, Space
from hydroviews.pairs.recipes.drops import Drops, draw_drops
from hydroviews.pairs.recipes.fields import halved
from hydroviews.pairs.recipes.lines import draw_lines
from hydroviews.pairs.recipes.panes import Pane, draw_pane
from hydroviews.pairs.recipes.shapes import Shapes
from hydroviews.pairs.recipes.stamps import stamp
from hydroviews.pairs.windows import draw_window_pane
from hydroviews.scene.images import to_linear, to_srgb
from hydroviews.scene.seeds import generator

PICTURE = photograph().astype(np.float32) / 255
LIGHT = np.array([0.9, 0.6, 0.5], np.float32)


@pytest.mark.parametrize(
    ("space", "there", "back"),
    [
        (LINEAR, to_linear, to_srgb),
        (ENCODED, np.copy, np.copy),
        (Space(1.7), lambda values: values**1.7, lambda values: values ** (1 / 1.7)),
    ],
)
def test_mist_is_mixed_in_any_space(space, there, back):
    veil = np.full((HEIGHT, WIDTH), 0.3, np.float32)
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


COLUMNS, ROWS = 240, 160
BLACK, WHITE = np.zeros((ROWS, COLUMNS, 3), np.float32), np.ones((ROWS, COLUMNS, 3), np.float32)


def stamped(*drops, aspect=1.0, turn=0.0):
    """Drops, each of x, y and radius, on a picture."""
    *places, radii = np.array(drops, float).T
    ones = np.ones(len(drops))
    shapes = Shapes(np.stack(places, 1), radii, aspect * ones, turn * ones, np.zeros((len(drops), 4)))
    return stamp(shapes, COLUMNS, ROWS)


@pytest.mark.parametrize(("aspect", "turn", "wide", "high"), [(1, 0, 10, 10), (4, 0, 20, 5), (4, np.pi / 2, 5, 20)])
def test_a_drop_is_as_large_as_said_and_where(aspect, turn, wide, high):
    cover, place, owner = stamped((100, 60, 10), aspect=aspect, turn=turn)
    assert cover.sum() == pytest.approx(np.pi * 100, rel=0.03)
    assert cover[60, 100 + wide - 2] == cover[60 + high - 2, 100] == 1
    assert cover[60, 100 + wide + 1] == cover[60 + high + 1, 100] == 0
    assert place[60, 100 + wide - 1] == pytest.approx((1, 0), abs=0.2)
    assert place[60 + high - 1, 100] == pytest.approx((0, 1), abs=0.2)
    assert set(np.unique(owner)) == {-1, 0}


def test_no_drop_lies_over_another_and_tiny_ones_cover_little():
    alone = stamped((50, 50, 10))
    for beside in (52, 58, 62):
        np.testing.assert_array_equal(stamped((50, 50, 10), (beside, 50, 5)).cover, alone.cover)
    assert set(np.unique(stamped((50, 50, 10), (70, 50, 5)).owner)) == {-1, 0, 1}
    assert stamped((50.5, 50.5, 0.4)).cover.sum() == pytest.approx(np.pi * 0.16, rel=0.6)


def test_drops_change_nothing_where_they_are_not():
    scene = np.random.default_rng(0).random(BLACK.shape).astype(np.float32)
    for seed in range(25):
        drops, _ = draw_drops(generator(seed), COLUMNS, ROWS, ENCODED)
        assert 0 <= drops.cover.min() <= drops.cover.max() <= 1
        dry = drops.cover == 0
        np.testing.assert_allclose(drops.over(scene)[dry], scene[dry], atol=1e-5)


def test_drops_show_their_surroundings_upside_down():
    cover, source = np.zeros((ROWS, COLUMNS), np.float32), np.zeros((ROWS, COLUMNS, 2), np.float32)
    cover[20:40, 30:50] = 1
    source[..., 0], source[..., 1] = np.meshgrid(np.arange(COLUMNS), ROWS - 1 - np.arange(ROWS))
    drops = Drops(cover, 0 * BLACK, cover, cover, source, "refracted", 0.1, 0.0, 1.0, False)
    scene = np.random.default_rng(0).random(BLACK.shape).astype(np.float32)
    seen = drops.over(scene)
    np.testing.assert_allclose(seen[25, 35], scene[ROWS - 26, 35], atol=1e-5)
    np.testing.assert_array_equal(seen[:20], scene[:20])
    smooth = np.repeat(np.linspace(0, 1, ROWS, dtype=np.float32)[:, None, None], COLUMNS, 1).repeat(3, 2)
    np.testing.assert_allclose(drops.half().over(halved(smooth)), halved(drops.over(smooth)), atol=0.02)


AIR = np.full(3, 0.6, np.float32)


def test_drops_of_a_window_have_light_of_their_own(window):
    """Over black and over white the drop looks nearly alike, dark above and bright below."""
    black, white = np.zeros_like(PICTURE), np.ones_like(PICTURE)
    for seed in range(12):
        pane, _ = draw_window_pane(window, AIR, generator(seed), has_mist=False)
        over_black, over_white = pane.over(black), pane.over(white)
        assert over_black[33:38, 35:45].mean() > over_black[22:27, 35:45].mean() + 0.1
        difference = over_white - over_black
        assert difference[23:27, 33:47].mean() < 0.45  # the scene's share is 0.15 at most, in linear light
        assert difference[:10, :10].mean() > 0.9


def test_parts_of_a_window_come_alone(window):
    misty, small = draw_window_pane(window, AIR, generator(0), has_drops=False)
    assert not any(plane.any() for plane in (misty.mask, small.mask, misty.lit))
    assert misty.veil.max() > 0
    wet, _ = draw_window_pane(window, AIR, generator(0), has_mist=False)
    assert wet.mask.any()
    assert not wet.veil.any()
    with pytest.raises(ValueError, match="window"):
        draw_window_pane(lens(), AIR, generator(0))
