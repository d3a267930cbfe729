import logging
from dataclasses import replace

import numpy as np
import pytest
from disturbed import assert_found, fitted, occluded
from splats import photographed
from trainings import psnr

from baselines.distractors.robust_filter import RobustFilter, RobustFilterConfig
from baselines.distractors.trimming import RECENT, TrimConfig, TrimmedObjective, faded
from baselines.gaussian_splatting import GaussianSplatting
from baselines.splatting.config import TrainerConfig
from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.objective import Objective
from baselines.splatting.strategies.densification import DefaultStrategy
from baselines.training.images import TrainingImages

STEADY = DefaultStrategy(start=1000, stop=1001, reset_every=None)
GROWTH = DefaultStrategy(
    start=20, stop=200, every=20, budget=300, grow_grad2d=5e-5, reset_every=None, prune_scale3d=1.0
)
SPLATTING = TrainerConfig(iterations=400, sh_degree=0, strategy=STEADY, device="cpu")


def random(seed, *shape):
    return np.random.default_rng(seed).random(shape).astype(np.float32)


def test_masks_fade_in_by_their_closed_form():
    """After t of T steps a pixel that is no outlier counts, and one that is with probability exp(-60 t / T)."""
    assert faded(0, 1 / 60) == 1
    assert faded(2000 / 30_000, 1 / 60) == pytest.approx(np.exp(-3e-3 * 2000 / 1.5))  # the authors' at step 2,000
    objective = TrimmedObjective(TrainingImages([np.zeros((60, 80, 3), np.uint8)]), RobustFilterConfig(SPLATTING), 0)
    outliers = np.zeros((60, 80), np.float32)
    share = np.mean([objective._drawn(outliers, iteration).mean() for iteration in range(40)])
    expected = np.mean(np.exp(-60 * np.arange(40) / 400))
    assert share == pytest.approx(expected, abs=0.005)
    assert not objective._drawn(outliers, 399).any()
    for iteration in (0, 5, 399):
        assert objective._drawn(outliers + 1, iteration).all()


def test_the_loss_is_that_of_the_inliers_and_the_same_as_ever_where_all_are():
    images = TrainingImages([np.full((24, 32, 3), 102, np.uint8)])
    config = RobustFilterConfig(replace(SPLATTING, lambda_dssim=0.0), TrimConfig(fade_in=1e-6))
    image = np.full((24, 32, 3), 0.4105, np.float32)
    image[8:16, 8:16] = 0.9
    loss, gradient = TrimmedObjective(images, config, 0)(image, 0, 100, BufferPool())
    assert not gradient[9:15, 9:15].any()
    assert gradient[:7].all()
    corners = 4  # of the square, whose neighbours outvote them
    assert loss == pytest.approx((0.0105 * (24 * 32 - 64) + 0.5 * corners) / (24 * 32), rel=1e-4)
    everything = replace(config, trim=replace(config.trim, inlier_share=1.0))
    ours = TrimmedObjective(images, everything, 0)(image, 0, 100, BufferPool())
    usual = Objective(images, 0.0)(image, 0, 100, BufferPool())
    assert ours[0] == usual[0]
    assert np.array_equal(ours[1], usual[1])


def test_percentiles_stay_once_growth_has_stopped():
    images = TrainingImages([np.zeros((24, 32, 3), np.uint8)])
    config = RobustFilterConfig(replace(SPLATTING, strategy=replace(STEADY, stop=10)))
    objective = TrimmedObjective(images, config, 0)
    objective(np.full((24, 32, 3), 0.5, np.float32), 0, 9, BufferPool())
    objective(np.full((24, 32, 3), 0.1, np.float32), 0, 10, BufferPool())
    assert objective.histogram.counts.sum() == 24 * 32


def test_what_is_hidden_moves_neither_percentiles_nor_the_share_of_pixels_that_count():
    class AllThatIsShown(TrimmedObjective):
        def probability(self, residuals, view, ignored):
            return (~ignored).astype(np.float32)

    images = TrainingImages([np.full((24, 32, 3), 200, np.uint8)], [np.indices((24, 32))[1] < 16])
    objective = AllThatIsShown(images, RobustFilterConfig(SPLATTING, TrimConfig(fade_in=1e-6)), 0)
    objective(random(0, 24, 32, 3), 0, 9, BufferPool())
    assert objective.histogram.counts.sum() == 24 * 16
    assert objective.report() == {"pixels": "100%"}


def test_hidden_neighbours_make_no_pixel_an_outlier():
    hidden = np.zeros((3, 3), bool)
    hidden[2], hidden[1, 0] = True, True
    images = TrainingImages([np.zeros((3, 3, 3), np.uint8)], [hidden])
    objective = TrimmedObjective(images, RobustFilterConfig(SPLATTING), 0)
    objective.histogram.observe(np.zeros((3, 3), np.float32))
    residuals = np.array([[0, 0, 0], [1, 1, 1], [1, 1, 1]], np.float32)
    assert objective.predicted(residuals, 0, hidden)[1, 1] == 1  # three of the five that are shown are inliers


def test_something_in_the_way_in_a_third_of_the_views_is_left_out(tmp_path):
    scene = photographed(tmp_path, n_views=24, width=96, height=72)
    shown = occluded(scene, tmp_path / "occluded", size=36)
    splatting = replace(SPLATTING, strategy=GROWTH)
    config = RobustFilterConfig(splatting, TrimConfig(inlier_share=0.9))
    plain = psnr(fitted(GaussianSplatting, splatting, shown, tmp_path / "plain"), scene.test_views)
    robust = fitted(RobustFilter, config, shown, tmp_path / "robust")
    assert psnr(robust, scene.test_views) > plain + 0.2  # seeds: 0.4 to 0.8
    assert_found(robust, shown, scene)


def test_a_mask_that_eats_everything_is_given_up_with_a_warning(caplog):
    class Greedy(TrimmedObjective):
        def probability(self, residuals, view, ignored):
            return np.zeros_like(residuals)

    images = TrainingImages([np.full((24, 32, 3), 200, np.uint8)])
    config = RobustFilterConfig(SPLATTING, TrimConfig(fade_in=1e-6))
    objective, image = Greedy(images, config, 0), random(0, 24, 32, 3)
    with caplog.at_level(logging.WARNING):
        for iteration in range(RECENT):
            assert not objective.given_up
            objective(image, 0, iteration, BufferPool())
    assert "masks leave 2.0 % of the pixels" in caplog.text  # those of the first step, before masks fade in
    assert objective.given_up
    usual = Objective(images)(image, 0, RECENT, BufferPool())
    assert objective(image, 0, RECENT, BufferPool())[0] == usual[0]
    assert objective.report() == {"pixels": "all, masks given up"}
    again = Greedy(images, config, 0)
    again.load_state_dict(objective.state_dict())
    assert again.given_up
    assert caplog.text.count("masks leave") == 1


def test_a_step_with_all_pixels_masked_or_hidden_is_finite():
    class Greedy(TrimmedObjective):
        def probability(self, residuals, view, ignored):
            return np.zeros_like(residuals)

    pixels = np.full((24, 32, 3), 200, np.uint8)
    config = RobustFilterConfig(SPLATTING, TrimConfig(fade_in=1e-6))
    loss, gradient = Greedy(TrainingImages([pixels]), config, 0)(random(0, 24, 32, 3), 0, 9, BufferPool())
    assert loss == 0
    assert not gradient.any()
    hidden = TrainingImages([pixels], [np.ones((24, 32), bool)])
    loss, gradient = TrimmedObjective(hidden, config, 0)(random(0, 24, 32, 3), 0, 9, BufferPool())
    assert loss == 0
    assert not gradient.any()
