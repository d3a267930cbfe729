"""Training: what it must reach, and that interruptions leave no trace."""

from dataclasses import replace

import numpy as np
import pytest
from disturbed import fitted
from trainings import BUDGETED, CONFIG, assert_identical, crashed_and_resumed, psnr

from baselines.gaussian_splatting import GaussianSplatting
from baselines.splatting.rasterizer import render
from baselines.splatting.trainer import train
from baselines.training.signals import Saving
from hydroviews.scene.images import resize_area


@pytest.fixture(scope="module")
def undisturbed(scene, tmp_path_factory):
    return train(scene, CONFIG, 0, tmp_path_factory.mktemp("run"))


@pytest.mark.parametrize("config", [CONFIG, BUDGETED], ids=["densification", "relocation"])
def test_a_synthetic_scene_is_learned_within_the_budget(scene, tmp_path, config):
    method = fitted(GaussianSplatting, replace(config, iterations=500), scene, tmp_path)
    assert method.summary().n_primitives <= 150
    assert config is CONFIG or method.summary().n_primitives == 150
    assert psnr(method, scene.train_views) > 30
    assert psnr(method, scene.test_views) > 26


@pytest.mark.parametrize("iteration", [0, 19, 20, 61, 137])
def test_a_crash_leaves_no_trace(scene, undisturbed, tmp_path, iteration):
    config = replace(CONFIG, checkpoint_seconds=0.0 if iteration != 61 else 0.05)
    assert_identical(undisturbed, crashed_and_resumed(scene, config, iteration, tmp_path))


def test_training_learns_the_antialiased_scene_it_renders(scene, undisturbed, tmp_path):
    far = [replace(view, camera=view.camera.resized(12, 9)) for view in scene.views]
    trained = train(scene, replace(CONFIG, antialiased=True), 0, tmp_path)
    assert trained.gaussians.means.tobytes() != undisturbed.gaussians.means.tobytes()
    errors = {}
    for name, gaussians, mode in (("antialiased", trained.gaussians, True), ("classic", undisturbed.gaussians, False)):
        images = [render(gaussians, view.camera, near=trained.near, antialiased=mode)[0] for view in far]
        truths = [resize_area(view.image(), 12, 9) for view in scene.views]
        errors[name] = np.mean([np.mean((image - truth) ** 2) for image, truth in zip(images, truths, strict=True)])
    assert errors["antialiased"] < errors["classic"]  # from four times as far away


def test_checkpoints_that_take_long_are_written_less_often():
    class Time:
        seconds = 0.0

    clock = Time()
    saving = Saving(clock, 30.0)
    clock.seconds = 31.0
    assert saving.due
    with saving.timed():
        clock.seconds += 5
    clock.seconds += 31
    assert not saving.due
    clock.seconds += 70
    assert saving.due
