"""Training that stops when views it does not learn from are no longer matched better."""

from dataclasses import replace

import numpy as np
import pytest
from trainings import CONFIG, assert_identical, crashed_and_resumed

from baselines.splatting.config import EarlyStop
from baselines.splatting.objective import Objective
from baselines.splatting.rasterizer import render
from baselines.splatting.schedule import validation_views
from baselines.splatting.trainer import train
from baselines.training.images import read_images
from hydroviews.errors import InputError

# Rates this large do harm sooner or later.
LARGE = replace(CONFIG.learning_rates, means=2e-3, means_final=2e-2, scales=0.02, opacity=0.2)
STOPPING = replace(CONFIG, iterations=1500, learning_rates=LARGE, early_stop=EarlyStop(views=2, every=25, patience=3))


class Watched(Objective):
    def __init__(self, images):
        super().__init__(images)
        self.seen = []

    def settings(self):
        return {"name": "Objective", "lambda_dssim": 0.2}

    def __call__(self, image, view, iteration, buffers):
        self.seen.append(view)
        return super().__call__(image, view, iteration, buffers)


@pytest.fixture(scope="module")
def stopped(scene, tmp_path_factory):
    """An undisturbed training."""
    return train(scene, STOPPING, 0, tmp_path_factory.mktemp("undisturbed"))


def test_validation_views_are_spread_evenly():
    assert validation_views(12, 3) == (2, 6, 10)
    assert validation_views(4, 3) == (0, 2, 3)
    with pytest.raises(InputError, match="no training view is left"):
        validation_views(3, 3)


def test_training_stops_where_validation_got_no_better(scene, tmp_path):
    objective = Watched(read_images(scene.train_views))
    trained = train(scene, STOPPING, 0, tmp_path, objective)
    best = int(np.argmin(trained.residuals))
    assert trained.iterations < 1500
    assert trained.iterations == 25 * len(trained.residuals) == 25 * (best + 1 + 3)
    held = validation_views(len(scene.train_views), 2)
    assert set(objective.seen) == set(range(len(scene.train_views))) - set(held)
    near, background = trained.near, np.zeros(3, np.float32)
    last = []
    for index in held:
        image, state = render(trained.gaussians, scene.train_views[index].camera, background, near=near)
        last.append(objective.residual(image, index, state.buffers))
    assert trained.residuals[-1] == pytest.approx(np.mean(last), rel=1e-5)


@pytest.mark.parametrize("iteration", [10, 30, 76])
def test_a_crash_leaves_no_trace(scene, stopped, tmp_path, iteration):
    config = replace(STOPPING, checkpoint_seconds=0.0)
    resumed = crashed_and_resumed(scene, config, iteration, tmp_path / "run")
    assert_identical(stopped, resumed)
    assert resumed.residuals == stopped.residuals
    again = train(scene, config, 0, tmp_path / "run")  # it has stopped, and stays so
    assert_identical(stopped, again)
    assert again.iterations == stopped.iterations
