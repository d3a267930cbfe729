"""Residuals, who is an inlier by them, and masks that are made of that."""

import logging
from dataclasses import replace

import numpy as np
import pytest

from baselines.distractors.robust_filter import RobustFilterConfig
from baselines.masking.residuals import BINS, ResidualHistogram, inliers, residuals_of
from baselines.masking.trimmed import RECENT, TrimConfig, TrimmedPixels, faded
from baselines.splatting.config import TrainerConfig
from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.kernels.photometric import prepare_target
from baselines.splatting.objective import Objective
from baselines.splatting.strategies.densification import DefaultStrategy
from baselines.training.images import TrainingImages
from hydroviews.scene.images import to_uint8

STEADY = DefaultStrategy(start=1000, stop=1001, reset_every=None)
SPLATTING = TrainerConfig(iterations=400, sh_degree=0, strategy=STEADY, device="cpu")


class Greedy(TrimmedPixels):
    """Takes nothing for the scene's."""

    def probability(self, residuals, view, ignored):
        return np.zeros_like(residuals)


class AllThatIsShown(TrimmedPixels):
    def probability(self, residuals, view, ignored):
        return np.ones_like(residuals) if ignored is None else (~ignored).astype(np.float32)


AT_ONCE = RobustFilterConfig(SPLATTING, TrimConfig(fade_in=1e-6))


def objective(kind, images, config=RobustFilterConfig(SPLATTING)):  # noqa: B008 (frozen)
    splatting = config.splatting
    return Objective(images, splatting.lambda_dssim, pixel_weights=kind(images, config.trim, splatting, 0))


def grey(level, ignored=()):
    return TrainingImages([np.full((24, 32, 3), level, np.uint8)], ignored)


def random(seed, *shape):
    return np.random.default_rng(seed).random(shape).astype(np.float32)


def test_masks_fade_in_by_their_closed_form():
    """After t of T steps a pixel that is no outlier counts, and one that is with probability exp(-60 t / T)."""
    assert faded(0, 1 / 60) == 1
    assert faded(2000 / 30_000, 1 / 60) == pytest.approx(np.exp(-3e-3 * 2000 / 1.5))  # the authors' at step 2,000
    images = TrainingImages([np.zeros((60, 80, 3), np.uint8)])

    def weights(kind, iteration):
        return objective(kind, images).weights(lambda: random(0, 60, 80, 3), 0, (60, 80), iteration, BufferPool())

    share = np.mean([weights(Greedy, iteration).mean() for iteration in range(40)])
    assert share == pytest.approx(np.mean(np.exp(-60 * np.arange(40) / 400)), abs=0.005)
    assert not weights(Greedy, 399).any()
    assert all(weights(AllThatIsShown, iteration).all() for iteration in (0, 5, 399))


def test_the_loss_is_that_of_the_inliers_and_the_same_as_ever_where_all_are():
    images, config = grey(102), replace(AT_ONCE, splatting=replace(SPLATTING, lambda_dssim=0.0))
    image = np.full((24, 32, 3), 0.4105, np.float32)
    image[8:16, 8:16] = 0.9
    loss, gradient = objective(TrimmedPixels, images, config)(image, 0, 100, BufferPool())
    assert not gradient[9:15, 9:15].any()
    assert gradient[:7].all()
    corners = 4  # of the square, whose neighbours outvote them
    assert loss == pytest.approx((0.0105 * (24 * 32 - 64) + 0.5 * corners) / (24 * 32), rel=1e-4)
    everything = replace(config, trim=replace(config.trim, inlier_share=1.0))
    ours = objective(TrimmedPixels, images, everything)(image, 0, 100, BufferPool())
    usual = Objective(images, 0.0)(image, 0, 100, BufferPool())
    assert ours[0] == usual[0]
    assert np.array_equal(ours[1], usual[1])


def test_what_is_hidden_moves_neither_percentiles_nor_the_share_of_pixels_that_count():
    rule = objective(AllThatIsShown, grey(200, [np.indices((24, 32))[1] < 16]), AT_ONCE)
    rule(random(0, 24, 32, 3), 0, 9, BufferPool())
    assert rule.pixel_weights.histogram.counts.sum() == 24 * 16
    assert rule.report() == {"pixels": "100%"}


def test_a_mask_that_eats_everything_is_given_up_with_a_warning(caplog):
    images, image = grey(200), random(0, 24, 32, 3)
    rule, again = (objective(Greedy, images, AT_ONCE) for _ in range(2))
    with caplog.at_level(logging.WARNING):
        for iteration in range(RECENT):
            assert not rule.pixel_weights.given_up
            rule(image, 0, iteration, BufferPool())
    assert "masks leave 2.0 % of the pixels" in caplog.text  # those of the first step, before masks fade in
    assert rule(image, 0, RECENT, BufferPool())[0] == Objective(images)(image, 0, RECENT, BufferPool())[0]
    again.load_state_dict(rule.state_dict())
    assert again.report() == rule.report() == {"pixels": "all, masks given up"}
    assert caplog.text.count("masks leave") == 1


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
    assert (histogram.counts[1000], histogram.counts[9000], histogram.counts.sum()) == (1, 2, 3)
    assert [histogram.percentile(share) for share in (0.33, 0.34)] == [1000, 9000]


def test_neighbours_vote_for_a_residual_that_stands_alone():
    residuals, brute = np.zeros((9, 9), np.float32), np.zeros((9, 9), bool)
    residuals[4, 4] = 1  # alone: detail
    residuals[0, 7:] = residuals[1, 7:] = 1  # in a corner, 4 of 4
    found = inliers(residuals, 0)
    assert found[4, 4]
    assert not found[0, 8]
    for y, x in np.ndindex(9, 9):
        around = residuals[max(y - 1, 0) : y + 2, max(x - 1, 0) : x + 2] == 0
        brute[y, x] = residuals[y, x] == 0 or around.mean() > 0.5
    assert np.array_equal(found, brute)


def test_hidden_neighbours_have_no_vote():
    residuals, hidden = np.ones((3, 3), np.float32), np.zeros((3, 3), bool)
    residuals[0], hidden[2] = 0, True
    assert not inliers(residuals, 0)[1, 1]  # three of nine
    assert not inliers(residuals, 0, hidden)[1, 1]  # three of six: no majority
    hidden[1, 0] = True
    assert inliers(residuals, 0, hidden)[1, 1]  # three of five
    assert not inliers(residuals, 0, np.ones((3, 3), bool))[2, 2]
