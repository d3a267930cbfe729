from dataclasses import replace

import numpy as np
import pytest
from splats import camera, photographed

from baselines.splatting.config import TrainerConfig
from baselines.splatting.strategies.relocation import MCMCStrategy
from baselines.wild_gaussians.sky import DISTANCE, Bounds, bounds_of, fibonacci, in_upper_part, with_room, with_sky
from hydroviews.scene.scenes import Points


def test_points_are_spread_evenly_over_the_sphere():
    points = fibonacci(1000)
    assert np.allclose(np.linalg.norm(points, axis=1), 1)
    assert np.abs(points.mean(axis=0)).max() < 1e-2
    distances = np.linalg.norm(points[:, None] - points[None], axis=2) + 9 * np.eye(1000)
    spacing = np.sqrt(4 * np.pi / 1000)
    assert distances.min() > 0.7 * spacing
    assert distances.min(axis=1).max() < 1.1 * spacing


def test_the_upper_two_thirds_of_a_picture():
    view = camera(30, 30)
    pixels = np.array([[15, 1], [15, 19], [15, 21], [-1, 5], [29, 5]])
    rays = np.stack([(pixels[:, 0] - view.cx) / view.fx, (pixels[:, 1] - view.cy) / view.fy, np.ones(5)], axis=1)
    positions = 7 * rays @ view.world_to_camera[:3, :3] + view.centre
    assert in_upper_part(positions, [view]).tolist() == [True, True, False, False, True]
    assert not in_upper_part(2 * view.centre - positions, [view]).any()  # behind the camera


def test_the_sky_lies_behind_the_scene_and_in_view(tmp_path):
    scene = photographed(tmp_path, n_views=3)
    bounds = bounds_of(scene)
    assert np.allclose(bounds.centre, scene.points.positions.mean(axis=0))
    inside = np.linalg.norm(scene.points.positions - bounds.centre, axis=1) <= bounds.radius
    assert inside.mean() == pytest.approx(0.97, abs=0.01)

    n, wider = len(scene.points), with_sky(scene, bounds, 500)
    sky = wider.points.positions[n:]
    assert 20 < len(sky) < 400
    assert np.array_equal(wider.points.positions[:n], scene.points.positions)
    assert np.allclose(np.linalg.norm(sky - bounds.centre, axis=1), DISTANCE * bounds.radius)
    assert in_upper_part(sky, [view.camera for view in scene.train_views]).all()
    assert with_sky(scene, bounds, 0) is scene


def test_points_that_are_no_numbers_do_not_move_the_bounds_and_few_have_those_of_the_cameras_and_no_sky(tmp_path):
    scene = photographed(tmp_path, n_views=3)
    positions = np.concatenate([scene.points.positions, [[np.nan, 0, 0]]])
    broken, few = (
        replace(scene, points=Points(given, np.zeros((len(given), 3), np.uint8)))
        for given in (positions, positions[:9])
    )
    assert np.array_equal(bounds_of(broken).centre, bounds_of(scene).centre)
    bounds = bounds_of(few)
    assert bounds.radius > 1
    assert with_sky(few, bounds, 500) is few


def test_gaussians_of_the_sky_may_be_as_large_as_they_are_far():
    bounds, config = Bounds(np.zeros(3), 2.0), TrainerConfig()
    roomy = with_room(config, bounds, 400, extent=2.0)
    assert roomy.strategy.prune_scale3d == pytest.approx(3 * 20 * np.sqrt(4 * np.pi / 400) / 2)
    assert replace(roomy, strategy=config.strategy) == config
    assert with_room(config, bounds, 0, 2.0) is config
    relocating = replace(config, strategy=MCMCStrategy())
    assert with_room(relocating, bounds, 400, 2.0) is relocating
