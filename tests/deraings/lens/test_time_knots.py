import numpy as np

from deraings.lens.time_knots import count_time_knots, time_weights, views_near


def test_time_knots_share_every_view():
    shares = np.stack([time_weights(view, 24, 3) for view in range(24)])
    assert np.allclose(shares.sum(axis=1), 1)
    assert shares[0, 0] == shares[-1, -1] == 1
    assert time_weights(0, 1, 1).tolist() == [1]


def test_there_are_as_many_time_knots_as_views_allow():
    assert [count_time_knots(views) for views in (1, 23, 24, 36, 500)] == [1, 1, 2, 3, 3]


def test_views_are_near_the_knot_that_weighs_most():
    near = [views_near(knot, 25, 3) for knot in range(3)]
    assert near == [list(range(7)), list(range(6, 19)), list(range(18, 25))]
