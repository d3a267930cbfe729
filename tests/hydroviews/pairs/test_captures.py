from dataclasses import replace

import numpy as np
import pytest
from wet import HEIGHT, WIDTH, lens, photograph

from hydroviews.pairs.captures import SMALLEST, Capture
from hydroviews.pairs.drawing import KINDS, draw_rain, shares_without
from hydroviews.pairs.lens_pool import halved
from hydroviews.pairs.rainy_pairs import DrawnRain
from hydroviews.scene.seeds import generator

ONES = np.ones(3, np.float32)


def test_pictures_of_a_capture_are_parts_of_its_photographs():
    rows, columns = np.mgrid[0:64, 0:96]  # values that say where they are
    ramp = np.stack([2 * rows, 2 * columns, 0 * rows], axis=-1).astype(np.uint8)
    pictures = Capture([ramp], False, ONES).pictures(40, (48, 32), (24, 16), generator(0)).astype(float) / 2
    assert pictures.shape == (40, 16, 24, 3)
    across = (pictures[:, 8, -1, 1] - pictures[:, 8, 0, 1]) * 24 / 23
    assert SMALLEST * 96 - 8 < across.min() < 60  # darker exposures shorten it
    assert across.max() > 75
    mirrored = Capture([ramp], True, ONES).pictures(3, (48, 32), (24, 16), generator(0))
    assert (mirrored[:, 8, 0, 1] > mirrored[:, 8, -1, 1]).all()


def test_a_lens_for_half_the_size_is_the_mean_of_the_lens():
    wet = lens().matte
    background = np.repeat(np.repeat(np.random.default_rng(0).random((32, 48, 3)), 2, 0), 2, 1).astype(np.float32)
    means = lambda plane: plane.reshape(32, 2, 48, 2, -1).mean((1, 3))  # noqa: E731
    half = halved(wet)
    np.testing.assert_allclose(half.mask[..., None], means(wet.mask), atol=1e-6)
    np.testing.assert_allclose(half.apply(background[::2, ::2]), means(wet.apply(background)), atol=1e-5)
    with pytest.raises(ValueError, match="even"):
        halved(lens(True, 63, 96).matte)
    bright = replace(wet, sky=wet.mask * np.float32(0.5))
    np.testing.assert_allclose(halved(bright).sky, half.mask / 2, atol=1e-6)


@pytest.mark.parametrize("kind", KINDS)
def test_companions_are_in_the_rain_of_their_picture(kind, lenses):
    """A companion that shows the same as the picture differs from it no more than by what is new in every picture."""
    companions = np.stack([photograph()[::2, ::2]] * 3)
    pair = draw_rain(photograph(), kind, lenses, generator(3, kind), companions)
    assert pair.companions.shape == (3, HEIGHT // 2, WIDTH // 2, 3)
    changed = np.abs(pair.companions - companions / 255).mean(axis=(1, 2, 3)).tolist()
    harm = float(np.abs(pair.rainy - pair.clean).mean())
    assert changed == pytest.approx([harm] * 3, rel=0.35, abs=1e-6)
    if kind in ("raindrop", "window", "pane"):
        own = pair.rainy.reshape(HEIGHT // 2, 2, WIDTH // 2, 2, 3).mean((1, 3))
        assert np.abs(pair.companions - own).mean() < 0.3 * harm
    if "+" in kind:
        assert not np.array_equal(pair.companions[0], pair.companions[1])
    if kind in ("streak", "lines"):
        assert np.abs(pair.companions[0] - pair.companions[1]).mean() > 0.1 * harm


def test_a_source_gives_as_many_companions_as_it_is_asked_for(lenses):
    pool = {(WIDTH, HEIGHT): tuple(lenses)}
    alone = DrawnRain([{96: photograph()}], pool)
    assert len(alone.pair(generator(0)).companions) == 0
    source = DrawnRain([{96: photograph()}, {96: photograph(1)}], pool, KINDS, (2, 5))
    assert {len(source.pair(generator(i)).companions) for i in range(20)} == {2, 5}
    rainy, clean, mist = source.misted(generator(0), 32, 7)
    assert rainy.shape == clean.shape == (7, 32, 32, 3)
    assert mist.shape == (32, 32, 4)


def test_mist_alone_is_of_the_families_that_are_left():
    """The data set's own mist is always put on in linear light, the recipes' often is not."""
    others = {"window", "raindrop", "streak"}, {"pane", "lines"}
    for families, unknown in zip(others, (True, False), strict=True):
        source = DrawnRain([{96: photograph()}], {}, shares_without(*families))
        mists = [source.misted(generator(seed), 32, 1)[2] for seed in range(12)]
        assert any(np.isnan(mist).any() for mist in mists) == unknown
