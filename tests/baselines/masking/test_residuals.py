import numpy as np

from baselines.masking.residuals import BINS, ResidualHistogram, inliers, residuals_of
from baselines.splatting.kernels.photometric import prepare_target
from hydroviews.scene.images import to_uint8


def random(seed, *shape):
    return np.random.default_rng(seed).random(shape).astype(np.float32)


def test_residuals_are_mean_absolute_differences_in_zero_to_one():
    image, photograph = 1.6 * random(0, 9, 11, 3) - 0.3, to_uint8(random(1, 9, 11, 3))
    expected = np.abs(image.astype(np.float64) - photograph / 255).mean(axis=2)
    assert np.allclose(residuals_of(image, prepare_target(photograph)), expected.clip(max=1), atol=1e-6)
    image[0, 0], image[0, 1] = np.nan, 50
    assert (residuals_of(image, prepare_target(photograph))[0, :2] == 1).all()


def test_percentiles_of_one_view_are_those_of_numpy():
    residuals = random(0, 40, 50) ** 2
    histogram = ResidualHistogram(0.95)
    assert histogram.percentile(0.5) == BINS - 1  # nothing is known: everything is an inlier
    histogram.observe(residuals)
    for share in (0.1, 0.5, 0.7, 0.9, 1.0):
        exact = np.quantile(residuals.astype(np.float64), share, method="inverted_cdf")
        assert histogram.percentile(share) == int(exact * BINS)


def test_older_views_count_for_less_and_hidden_pixels_for_nothing():
    histogram = ResidualHistogram(0.5)
    histogram.observe(np.full((2, 2), 0.9, np.float32))
    histogram.observe(np.array([[0.1, 0.5]], np.float32), np.array([[False, True]]))
    assert histogram.counts[9000] == 2
    assert histogram.counts[1000] == 1
    assert histogram.counts.sum() == 3
    assert [histogram.percentile(share) for share in (0.33, 0.34)] == [1000, 9000]


def test_neighbours_vote_for_a_residual_that_stands_alone():
    residuals = np.zeros((9, 9), np.float32)
    residuals[4, 4] = 1  # alone: detail
    residuals[0, 7:] = residuals[1, 7:] = 1  # in a corner, 4 of 4
    found = inliers(residuals, 0)
    assert found[4, 4]
    assert not found[0, 8]
    assert found[:7, :5].all()
    brute = np.zeros((9, 9), bool)
    for y, x in np.ndindex(9, 9):
        around = residuals[max(y - 1, 0) : y + 2, max(x - 1, 0) : x + 2] == 0
        brute[y, x] = residuals[y, x] == 0 or around.mean() > 0.5
    assert np.array_equal(found, brute)


def test_hidden_neighbours_have_no_vote():
    residuals = np.ones((3, 3), np.float32)
    residuals[0] = 0
    hidden = np.zeros((3, 3), bool)
    hidden[2] = True
    assert not inliers(residuals, 0)[1, 1]  # three of nine
    assert not inliers(residuals, 0, hidden)[1, 1]  # three of six: no majority
    hidden[1, 0] = True
    assert inliers(residuals, 0, hidden)[1, 1]  # three of five
    assert not inliers(residuals, 0, np.ones((3, 3), bool))[2, 2]
