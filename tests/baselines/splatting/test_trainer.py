"""Training: what it reaches, when it stops, what images it begins with, parameters that are lost, interruptions."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from disturbed import fitted
from splats import photographed
from trainings import BUDGETED, CONFIG, assert_identical, crashed_and_resumed, psnr

from baselines.gaussian_splatting import GaussianSplatting
from baselines.splatting.backends.base import CpuBackend
from baselines.splatting.config import EarlyStop
from baselines.splatting.objective import Objective
from baselines.splatting.rasterizer import render
from baselines.splatting.schedule import shrunk, validation_views
from baselines.splatting.trainer import train
from baselines.training.images import TrainingImages, read_images
from baselines.training.signals import Saving
from hydroviews.errors import InputError
from hydroviews.scene.cameras import Camera
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
    trained = train(scene, replace(CONFIG, antialiased=True), 0, tmp_path)
    assert trained.gaussians.means.tobytes() != undisturbed.gaussians.means.tobytes()

    def error(learned, antialiased):
        """The mean over pictures from four times as far away."""
        errors = []
        for view in scene.views:
            image, _ = render(learned.gaussians, view.camera.resized(12, 9), near=learned.near, antialiased=antialiased)
            errors.append(np.mean((image - resize_area(view.image(), 12, 9)) ** 2))
        return np.mean(errors)

    assert error(trained, True) < error(undisturbed, False)


def test_checkpoints_that_take_long_are_written_less_often():
    clock = SimpleNamespace(seconds=0.0)
    saving = Saving(clock, 30.0)
    clock.seconds = 31.0
    assert saving.due
    with saving.timed():
        clock.seconds += 5
    clock.seconds += 31
    assert not saving.due
    clock.seconds += 70
    assert saving.due


# Rates this large do harm sooner or later.
LARGE = replace(CONFIG.learning_rates, means=2e-3, means_final=2e-2, scales=0.02, opacity=0.2)
STOPPING = replace(CONFIG, iterations=1500, learning_rates=LARGE, early_stop=EarlyStop(views=2, every=25, patience=3))


class Watched(Objective):
    """Notes the views and the sizes that it is asked about."""

    def __init__(self, images):
        super().__init__(images)
        self.views, self.sizes = [], []

    def settings(self):
        return {"name": "Objective", "lambda_dssim": 0.2}

    def __call__(self, image, view, iteration, buffers):
        self.views.append(view)
        self.sizes.append(image.shape[:2])
        return super().__call__(image, view, iteration, buffers)


def test_validation_views_are_spread_evenly():
    assert validation_views(12, 3) == (2, 6, 10)
    assert validation_views(4, 3) == (0, 2, 3)
    with pytest.raises(InputError, match="no training view is left"):
        validation_views(3, 3)


def test_training_stops_where_validation_got_no_better(scene, tmp_path):
    objective = Watched(read_images(scene.train_views))
    trained = train(scene, STOPPING, 0, tmp_path, objective)
    best = int(np.argmin(trained.residuals))
    assert trained.iterations == 25 * len(trained.residuals) == 25 * (best + 1 + 3) < 1500
    held, last = validation_views(len(scene.train_views), 2), []
    assert set(objective.views) == set(range(len(scene.train_views))) - set(held)
    for index in held:
        camera, black = scene.train_views[index].camera, np.zeros(3, np.float32)
        image, state = render(trained.gaussians, camera, black, near=trained.near)
        last.append(objective.residual(image, index, state.buffers))
    assert trained.residuals[-1] == pytest.approx(np.mean(last), rel=1e-5)


@pytest.fixture(scope="module")
def stopped(scene, tmp_path_factory):
    return train(scene, STOPPING, 0, tmp_path_factory.mktemp("undisturbed"))


@pytest.mark.parametrize("iteration", [10, 30, 76])
def test_a_crash_does_not_change_when_it_stops(scene, stopped, tmp_path, iteration):
    config = replace(STOPPING, checkpoint_seconds=0.0)
    resumed = crashed_and_resumed(scene, config, iteration, tmp_path)
    again = train(scene, config, 0, tmp_path)  # it has stopped, and stays so
    for trained in (resumed, again):
        assert_identical(stopped, trained)
        assert (trained.residuals, trained.iterations) == (stopped.residuals, stopped.iterations)


def test_small_cameras_see_the_same():
    camera = Camera(53, 37, 60, 61, 25, 19, np.eye(4))
    small = shrunk(camera, 4)
    assert (small.width, small.height) == (13, 9)
    points = np.random.default_rng(0).uniform(-1, 1, (20, 3)) + np.array([0, 0, 4])
    assert np.allclose(small.project(points)[0] * (53 / 13, 37 / 9), camera.project(points)[0])
    assert shrunk(camera, 1) is camera


def test_targets_are_averages_over_areas():
    pixels, hidden = np.random.default_rng(0).integers(0, 256, (8, 12, 3), np.uint8), np.zeros((8, 12), bool)
    images = TrainingImages([pixels])
    expected = pixels.reshape(4, 2, 6, 2, 3).mean(axis=(1, 3))
    assert np.abs(images.pixels(0, (4, 6)) - expected).max() <= 0.5
    assert images.ignored(0, (4, 6)) is None
    objective = Objective(images)
    assert objective.target(0, (4, 6)).pixels is images.pixels(0, (4, 6))
    assert objective.target(0, (8, 12)).pixels is objective.target(0).pixels is pixels
    hidden[3, 5] = True  # and so is a small pixel that touches it
    images, small = TrainingImages([pixels], [hidden]), np.zeros((4, 6), bool)
    small[1, 2] = True
    assert np.array_equal(images.ignored(0, (4, 6)), small)
    assert np.array_equal(Objective(images).target(0, (4, 6)).shown == 0, small)


def test_a_scene_is_learnt_from_small_images_first(tmp_path):
    uneven, coarse = photographed(tmp_path, 12, 50, 38), replace(CONFIG, resolutions=((0.25, 4), (0.25, 2)))
    objective = Watched(read_images(uneven.train_views))
    train(uneven, coarse, 0, tmp_path / "watched", objective)
    assert objective.sizes == 50 * [(10, 13)] + 50 * [(19, 25)] + 100 * [(38, 50)]
    method = fitted(GaussianSplatting, replace(coarse, iterations=500), uneven, tmp_path / "run")
    assert psnr(method, uneven.train_views) > 30
    assert psnr(method, uneven.test_views) > 26
    assert method.render(uneven.views[0].camera).shape == (38, 50, 3)


BAD = (("means", np.nan), ("quaternions", np.inf), ("log_scales", np.inf), ("opacity_logits", np.nan), ("sh", -np.inf))


@pytest.fixture
def injected(monkeypatch):
    """Makes a parameter each of five Gaussians non-finite before given steps."""
    step = CpuBackend.step

    def inject_at(*iterations):
        def spoilt_step(self, camera, view, iteration, *arguments):
            if iteration in iterations:
                for row, (name, value) in enumerate(BAD):
                    getattr(self._state.gaussians, name)[row] = value
            return step(self, camera, view, iteration, *arguments)

        monkeypatch.setattr(CpuBackend, "step", spoilt_step)

    return inject_at


def assert_left_out(trained, count):
    assert trained.non_finite == count
    assert all(np.isfinite(value).all() for value in trained.gaussians.state_dict().values())


@pytest.mark.parametrize("config", [CONFIG, BUDGETED], ids=["densification", "relocation"])
def test_training_goes_on_without_them_and_warns_once(scene, tmp_path, injected, caplog, config):
    injected(45, 90, 170)
    method = fitted(GaussianSplatting, replace(config, iterations=400), scene, tmp_path)
    (said,) = [message for message in caplog.messages if "NaN or infinite" in message]
    assert "training: 5 of " in said
    assert "after iteration 60, as" in said
    assert "means of 1, quaternions of 1, log_scales of 1, opacity_logits of 1, sh of 1" in said
    assert_left_out(method._trained, 15)
    assert psnr(method, scene.train_views) > 28


def test_what_is_non_finite_at_the_end_is_not_in_the_model(scene, tmp_path, injected):
    injected(29)
    assert_left_out(train(scene, replace(CONFIG, iterations=30), 0, tmp_path), 5)


def test_a_training_that_leaves_nothing_has_failed(scene, tmp_path, monkeypatch):
    def step(self, *_):
        self._state.gaussians.means[:] = np.nan
        return 0.1

    monkeypatch.setattr(CpuBackend, "step", step)
    with pytest.raises(FloatingPointError, match="no Gaussian is left after 2 iterations"):
        train(scene, replace(CONFIG, iterations=2), 0, tmp_path)
