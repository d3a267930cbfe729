import numpy as np

from deraings.rain_model.time_knots import count_time_knots, time_weights


def test_time_knots_share_every_view():
    shares = np.stack([time_weights(view, 24, 3) for view in range(24)])
    assert np.allclose(shares.sum(axis=1), 1)
    assert shares[0, 0] == shares[-1, -1] == 1
    assert time_weights(0, 1, 1).tolist() == [1]


def test_there_are_as_many_time_knots_as_views_allow():
    assert [count_time_knots(views, 12, 3) for views in (1, 23, 24, 36, 500)] == [1, 1, 2, 3, 3]
