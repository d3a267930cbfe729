"""Which photographs one lens took, held one way, and when; what masks make of others."""

import numpy as np

from deraings.lens.time_knots import count_time_knots, time_weights, views_near
from deraings.lens.views import by_shape, mean_around, one_shape
from deraings.masks.maps import evidence

WIDE, UPRIGHT = (60, 80), (80, 60)


def test_shapes_are_those_of_a_lens():
    assert one_shape(WIDE, (600, 798))
    assert not one_shape(WIDE, UPRIGHT)
    assert by_shape([UPRIGHT, WIDE, (120, 160)]) == [[1, 2], [0]]
    assert by_shape([UPRIGHT, WIDE]) == [[0], [1]]


def test_masks_compare_places_of_one_lens():
    rng = np.random.default_rng(0)
    same = rng.random((12, 16), np.float32)
    wide = [same + np.float32(0.1) * rng.random(same.shape, np.float32) for _ in range(6)]
    upright = [rng.random((16, 12), np.float32) for _ in range(3)]
    assert evidence([*upright, *wide]) == evidence(wide) > 0.8
    assert np.allclose(mean_around(0, dict(enumerate([*upright, same])), same.shape, 8.0), same, atol=1e-6)


def test_time_knots_share_every_view_and_are_as_many_as_views_allow():
    shares = np.stack([time_weights(view, 24, 3) for view in range(24)])
    assert np.allclose(shares.sum(axis=1), 1)
    assert shares[0, 0] == shares[-1, -1] == 1
    assert time_weights(0, 1, 1).tolist() == [1]
    assert [count_time_knots(views) for views in (1, 23, 24, 36, 500)] == [1, 1, 2, 3, 3]
    near = [views_near(knot, 25, 3) for knot in range(3)]
    assert near == [list(range(7)), list(range(6, 19)), list(range(18, 25))]
