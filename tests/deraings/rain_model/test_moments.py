import numpy as np

from deraings.rain_model.moments import moment_weights, moments_of


def test_moments_share_every_view():
    shares = np.stack([moment_weights(view, 24, 3) for view in range(24)])
    assert np.allclose(shares.sum(axis=1), 1)
    assert shares[0, 0] == shares[-1, -1] == 1
    assert moment_weights(0, 1, 1).tolist() == [1]


def test_there_are_as_many_moments_as_views_allow():
    assert [moments_of(views, 12, 3) for views in (1, 23, 24, 36, 500)] == [1, 1, 2, 3, 3]
