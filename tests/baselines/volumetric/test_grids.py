"""Grids of rays in photographs: inside, regular, everywhere in the long run; what networks see of photographs."""

import balls
import numpy as np
import pytest
import torch

from baselines.training.images import TrainingImages, read_images
from baselines.volumetric.rays.batches import TrainingPixels
from baselines.volumetric.rays.grids import grid, grids, side_of_grids, views_in_turn
from baselines.volumetric.rays.photographs import as_seen, rays_of_the_mean, small_pictures
from baselines.volumetric.rays.rays import camera_rays
from baselines.volumetric.rays.spaces import Contracted
from hydroviews.scene.seeds import generator


@pytest.mark.parametrize(("height", "width"), [(24, 32), (5, 90)])
def test_grids_stay_inside_and_reach_every_pixel(height, width):
    met = np.zeros((height, width), int)
    random = np.random.default_rng(0)
    for _ in range(2000):
        rows, columns = grid(height, width, 8, 0.5, random)
        assert rows.min() >= 0
        assert columns.min() >= 0
        met[rows, columns] += 1  # out of range would raise
    assert met.min() > 0


def test_grids_are_regular_and_as_large_as_was_said():
    random = np.random.default_rng(1)
    spans = []
    for _ in range(300):
        rows, columns = grid(1000, 2000, 11, 0.5, random).reshape(2, 11, 11)
        assert (rows == rows[:, :1]).all()
        assert (columns == columns[:1]).all()
        steps = np.diff(columns[0])
        assert np.ptp(steps) <= 1
        assert np.ptp(np.diff(rows[:, 0])) <= 1
        spans.append(steps.sum() / 2000 / (10 / 11))
        assert abs(np.diff(rows[:, 0]).mean() / 1000 - steps.mean() / 2000) < 2e-4  # one share of both sides
    assert 0.49 < min(spans) < 0.52
    assert 0.98 < max(spans) < 1.01


@pytest.mark.parametrize(("photographs", "views"), [(1, 7), (4, 7), (3, 1)])
def test_views_come_in_turn(photographs, views):
    steps = [views_in_turn(3, iteration, photographs, views) for iteration in range(views)]
    assert all(len(step) == photographs for step in steps)
    counts = np.bincount(np.concatenate(steps), minlength=views)
    assert (counts == photographs).all()
    assert views == 1 or any(
        not np.array_equal(step, views_in_turn(4, i, photographs, views)) for i, step in enumerate(steps)
    )


def test_a_step_has_the_pixels_of_its_photograph(tmp_path):
    scene = balls.photographed(tmp_path, n_views=6)
    cameras = [view.camera for view in scene.train_views]
    pixels, space = TrainingPixels(cameras, read_images(scene.train_views)), Contracted((0.0, 0.0, 0.0), 1.0, 0.2, 5.0)
    batch = grids(4, 8)(pixels, 0, 5, 256, space, torch.device("cpu"))
    views = views_in_turn(0, 5, 4, len(cameras))
    assert batch.views.tolist() == np.repeat(views, 64).tolist()
    random = generator(0, "grid", 5)
    for part, view in enumerate(views):
        rows, columns = grid(24, 32, 8, 0.5, random)
        here = slice(64 * part, 64 * part + 64)
        expected = scene.train_views[view].image()[rows, columns]
        np.testing.assert_allclose(batch.colours[here], expected, atol=1e-6)
        np.testing.assert_allclose(
            batch.places[here], np.stack([(rows + 0.5) / 24, (columns + 0.5) / 32], 1), rtol=1e-6
        )
        world = camera_rays(cameras[view])
        exact = world.directions.reshape(24, 32, 3)[rows, columns]
        exact = exact / np.linalg.norm(exact, axis=1, keepdims=True)
        np.testing.assert_allclose(batch.rays.viewing[here], exact, atol=1e-6)


def test_rays_that_make_no_square_are_refused():
    assert side_of_grids(256, 4) == 8
    for photographs in (0, 2, 300):
        with pytest.raises(ValueError, match=f"256 rays a step in {photographs} photographs"):
            side_of_grids(256, photographs)


def test_what_is_hidden_of_a_picture_is_not_seen():
    hidden = np.zeros((240, 320), bool)
    hidden[:, 100:200] = True
    looks = []
    for value in (0, 255):
        picture = np.full((240, 320, 3), 100, np.uint8)
        picture[hidden] = value
        looks.append(small_pictures(TrainingImages([picture], [hidden]), 16))
    assert torch.equal(*looks)
    assert looks[0].max() == 100
    np.testing.assert_allclose(as_seen(torch.tensor([0, 255], dtype=torch.uint8)), [-1, 1])


@pytest.mark.parametrize("share", [0.0, 0.25, 0.3, 0.5, 1.0])
def test_rays_of_the_mean_look_are_a_share_spread_evenly(share):
    chosen = rays_of_the_mean(1000, share, torch.device("cpu"))
    assert abs(int(chosen.sum()) - 1000 * share) <= 1
    parts = chosen.view(10, 100).sum(1)
    assert int(parts.max() - parts.min()) <= 1
