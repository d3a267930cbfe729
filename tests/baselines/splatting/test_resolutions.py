"""Training that begins with smaller images."""

from dataclasses import replace

import numpy as np
import pytest
from splats import photographed
from trainings import CONFIG, Interrupted, psnr

from baselines.gaussian_splatting import GaussianSplatting
from baselines.splatting.objective import Objective
from baselines.splatting.rasterizer import render
from baselines.splatting.schedule import shrunk
from baselines.splatting.trainer import train
from baselines.training.images import TrainingImages, read_images
from hydroviews.scene.cameras import Camera

COARSE = replace(CONFIG, resolutions=((0.25, 4), (0.25, 2)))


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return photographed(tmp_path_factory.mktemp("scene"), 12, 50, 38)


def test_small_cameras_see_the_same():
    camera = Camera(53, 37, 60, 61, 25, 19, np.eye(4))
    small = shrunk(camera, 4)
    assert (small.width, small.height) == (13, 9)
    points = np.random.default_rng(0).uniform(-1, 1, (20, 3)) + np.array([0, 0, 4])
    assert np.allclose(small.project(points)[0] * (53 / 13, 37 / 9), camera.project(points)[0])
    assert shrunk(camera, 1) is camera


def test_targets_are_averages_over_areas():
    pixels = np.random.default_rng(0).integers(0, 256, (8, 12, 3), np.uint8)
    images = TrainingImages([pixels])
    expected = pixels.reshape(4, 2, 6, 2, 3).mean(axis=(1, 3))
    assert np.abs(images.pixels(0, (4, 6)) - expected).max() <= 0.5
    objective = Objective(images)
    assert objective.target(0, (4, 6)).pixels is images.pixels(0, (4, 6))
    assert objective.target(0, (8, 12)).pixels is objective.target(0).pixels is pixels
    assert images.ignored(0, (4, 6)) is None


def test_a_small_pixel_that_touches_a_hidden_one_is_hidden():
    hidden = np.zeros((8, 12), bool)
    hidden[3, 5] = True
    images = TrainingImages([np.full((8, 12, 3), 200, np.uint8)], [hidden])
    expected = np.zeros((4, 6), bool)
    expected[1, 2] = True
    assert np.array_equal(images.ignored(0, (4, 6)), expected)
    assert np.array_equal(Objective(images).target(0, (4, 6)).shown == 0, expected)


def test_a_scene_is_learnt_from_small_images_first(scene, tmp_path):
    sizes = []

    class Watched(Interrupted):
        def __call__(self, image, view, iteration, buffers):
            sizes.append(image.shape[:2])
            return super().__call__(image, view, iteration, buffers)

    train(scene, COARSE, 0, tmp_path / "watched", Watched(read_images(scene.train_views), -1, None))
    assert sizes == 50 * [(10, 13)] + 50 * [(19, 25)] + 100 * [(38, 50)]
    method = GaussianSplatting(replace(COARSE, iterations=500), 0)
    method.fit(scene, tmp_path / "run")
    assert psnr(method, scene.train_views) > 30
    assert psnr(method, scene.test_views) > 26
    assert render(method._trained.gaussians, scene.views[0].camera)[0].shape == (38, 50, 3)
