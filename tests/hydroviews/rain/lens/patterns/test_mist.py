from dataclasses import replace

import cv2
import numpy as np
import pytest

from hydroviews.rain.lens.patterns.mist import mist_veil
from hydroviews.rain.lens.patterns.pattern import draw_pattern
from hydroviews.rain.lens.patterns.runs import draw_rivulets

PATTERN = replace(draw_pattern(np.random.default_rng(3), 1), mist=0.5, rivulets=0, seed=0)


@pytest.mark.parametrize("seed", range(4))
def test_mist_is_smooth_and_within_its_level(seed):
    veil = mist_veil(replace(PATTERN, seed=seed), 160, 120, 0.0)
    assert 0 <= veil.min() < 0.2
    assert 0.3 < veil.max() <= 0.5
    assert max(np.abs(np.diff(veil, axis=axis)).max() for axis in (0, 1)) < 0.5 / 15


def test_level_scales_the_same_form():
    strong, weak, none = (mist_veil(replace(PATTERN, mist=level), 64, 48, 0.0) for level in (0.8, 0.2, 0.0))
    np.testing.assert_allclose(strong, 4 * weak, rtol=1e-5)
    assert not none.any()


def test_the_form_does_not_depend_on_the_size_of_the_picture():
    large, small = mist_veil(PATTERN, 640, 480, 0.5), mist_veil(PATTERN, 64, 48, 0.5)
    shrunk = cv2.resize(large, (64, 48), interpolation=cv2.INTER_AREA)
    np.testing.assert_allclose(shrunk, small, atol=0.01)


def test_running_drops_wipe_it_thin():
    pattern = replace(PATTERN, rivulets=3)
    wiped, whole = mist_veil(pattern, 240, 240, 0.0), mist_veil(PATTERN, 240, 240, 0.0)
    way = np.concatenate([rivulet.way for rivulet in draw_rivulets(pattern, (1.0, 1.0), 0.0)])
    column, row = (way[np.all((way > 0) & (way < 1), axis=1)] * 240).astype(int).T
    assert wiped[row, column].sum() < 0.4 * whole[row, column].sum()
    assert np.median(wiped / np.maximum(whole, 1e-9)) > 0.99
