"""Photographs of several shapes: what is on a lens is looked for where one lens took them, held one way."""

import numpy as np
import panorama

from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.training.images import TrainingImages
from deraings.lens_views import hide_other_lenses, one_shape, views_of_one_lens
from deraings.masks.maps import evidence, mean_around
from deraings.rain_model.mist_config import MistConfig
from deraings.rain_model.model import RainConfig, RainModel

WIDE, UPRIGHT = (60, 80), (80, 60)
CONFIG = RainConfig(mist=MistConfig(start=0), rain_layer=None, streaks=None)


def misty_views():
    """Ten wide views behind much mist, and two upright ones without any."""
    views = panorama.views_of(panorama.paint(size=(120, 200)), 10, size=WIDE)
    mist = np.tile(np.linspace(0, 0.4, WIDE[1], dtype=np.float32), (WIDE[0], 1))
    misted = panorama.eight_bit(panorama.misted(views, mist, np.array([0.7, 0.7, 0.7])))
    upright = panorama.eight_bit(panorama.views_of(panorama.paint(size=(120, 200)), 2, size=UPRIGHT))
    return [*upright, *misted]


def test_one_lens_took_what_has_the_shape_of_most():
    assert one_shape((60, 80), (600, 798))
    assert not one_shape(WIDE, UPRIGHT)
    assert views_of_one_lens([UPRIGHT, WIDE, (120, 160)]) == [False, True, True]
    assert views_of_one_lens([UPRIGHT, WIDE]) == [True, False]
    assert views_of_one_lens([]) == []


def test_others_are_black_and_hidden():
    views = [np.full((*UPRIGHT, 3), 9, np.uint8), np.full((*WIDE, 3), 7, np.uint8)]
    pictures, hidden = hide_other_lenses(views, [None, None], [False, True])
    assert pictures[0].shape == (*WIDE, 3)
    assert not pictures[0].any()
    assert hidden[0].all()
    assert pictures[1] is views[1]
    assert hidden[1] is None


def test_mist_is_looked_for_in_views_of_one_lens(caplog):
    mixed = RainModel(TrainingImages(misty_views()), 100, CONFIG)
    assert "2 of 12" in caplog.text
    assert mixed.mist.wanted
    assert mixed.mist_alpha(6, WIDE).max() > 0.05
    for view in (0, 1):
        image = np.full((*UPRIGHT, 3), np.float32(0.3))
        assert mixed.forward(image, view, 50, BufferPool()).image is image
        assert not mixed.mist_alpha(view, UPRIGHT).any()


def test_views_of_one_shape_are_one_lens(caplog):
    RainModel(TrainingImages(misty_views()[2:]), 100, CONFIG)
    assert not caplog.text


def test_masks_compare_places_of_one_lens():
    rng = np.random.default_rng(0)
    same = rng.random((12, 16), np.float32)
    wide = [same + np.float32(0.1) * rng.random(same.shape, np.float32) for _ in range(6)]
    upright = [rng.random((16, 12), np.float32) for _ in range(3)]
    assert evidence([*upright, *wide]) == evidence(wide) > 0.8
    assert np.allclose(mean_around(0, dict(enumerate([*upright, same])), same.shape, 8.0), same, atol=1e-6)
