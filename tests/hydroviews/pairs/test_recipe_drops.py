import numpy as np
import pytest

from hydroviews.pairs.recipes.compositing import ENCODED
from hydroviews.pairs.recipes.drops import Drops, draw_drops
from hydroviews.pairs.recipes.fields import halved
from hydroviews.pairs.recipes.shapes import Shapes
from hydroviews.pairs.recipes.stamps import stamp
from hydroviews.scene.seeds import generator

WIDTH, HEIGHT = 240, 160
BLACK, WHITE = np.zeros((HEIGHT, WIDTH, 3), np.float32), np.ones((HEIGHT, WIDTH, 3), np.float32)


def shapes(middles, radii, aspect=1.0, turn=0.0):
    count = len(radii)
    ones = np.ones(count)
    places = np.array(middles, float).reshape(count, 2)
    return Shapes(places, np.array(radii, float), aspect * ones, turn * ones, np.zeros((count, 4)))


@pytest.mark.parametrize(("aspect", "turn", "wide", "high"), [(1, 0, 10, 10), (4, 0, 20, 5), (4, np.pi / 2, 5, 20)])
def test_a_drop_is_as_large_as_said_and_where(aspect, turn, wide, high):
    cover, place, owner = stamp(shapes([[100, 60]], [10], aspect, turn), WIDTH, HEIGHT)
    assert cover.sum() == pytest.approx(np.pi * 100, rel=0.03)
    assert cover[60, 100 + wide - 2] == cover[60 + high - 2, 100] == 1
    assert cover[60, 100 + wide + 1] == cover[60 + high + 1, 100] == 0
    assert place[60, 100 + wide - 1] == pytest.approx((1, 0), abs=0.2)
    assert place[60 + high - 1, 100] == pytest.approx((0, 1), abs=0.2)
    assert set(np.unique(owner)) == {-1, 0}


def test_no_drop_lies_over_another_and_tiny_ones_cover_little():
    alone = stamp(shapes([[50, 50]], [10]), WIDTH, HEIGHT)
    for beside in (52, 58, 62):
        both = stamp(shapes([[50, 50], [beside, 50]], [10, 5]), WIDTH, HEIGHT)
        np.testing.assert_array_equal(both.cover, alone.cover)
    assert set(np.unique(stamp(shapes([[50, 50], [70, 50]], [10, 5]), WIDTH, HEIGHT).owner)) == {-1, 0, 1}
    tiny = stamp(shapes([[50.5, 50.5]], [0.4]), WIDTH, HEIGHT)
    assert tiny.cover.sum() == pytest.approx(np.pi * 0.16, rel=0.6)


def test_drops_change_nothing_where_they_are_not():
    scene = np.random.default_rng(0).random(BLACK.shape).astype(np.float32)
    for seed in range(25):
        drops, _ = draw_drops(generator(seed), WIDTH, HEIGHT, ENCODED)
        assert 0 <= drops.cover.min() <= drops.cover.max() <= 1
        dry = drops.cover == 0
        np.testing.assert_allclose(drops.over(scene)[dry], scene[dry], atol=1e-5)


def test_drops_show_their_surroundings_upside_down():
    cover, source = np.zeros((HEIGHT, WIDTH), np.float32), np.zeros((HEIGHT, WIDTH, 2), np.float32)
    cover[20:40, 30:50] = 1
    source[..., 0], source[..., 1] = np.meshgrid(np.arange(WIDTH), HEIGHT - 1 - np.arange(HEIGHT))
    drops = Drops(cover, 0 * BLACK, cover, cover, source, "refracted", 0.1, 0.0, 1.0, False)
    scene = np.random.default_rng(0).random(BLACK.shape).astype(np.float32)
    seen = drops.over(scene)
    np.testing.assert_allclose(seen[25, 35], scene[HEIGHT - 26, 35], atol=1e-5)
    np.testing.assert_array_equal(seen[:20], scene[:20])
    smooth = np.repeat(np.linspace(0, 1, HEIGHT, dtype=np.float32)[:, None, None], WIDTH, 1).repeat(3, 2)
    expected, small = halved(drops.over(smooth)), drops.half().over(halved(smooth))
    np.testing.assert_allclose(small, expected, atol=0.02)
