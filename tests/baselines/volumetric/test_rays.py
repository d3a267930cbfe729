"""Rays against projection, their spaces against what is known of them, and grids of them in photographs."""

from dataclasses import replace

import balls
import numpy as np
import pytest
import torch
from splats import camera

from baselines.training.images import TrainingImages, read_images
from baselines.volumetric.rays.batches import TrainingPixels
from baselines.volumetric.rays.grids import grid, grids, side_of_grids, views_in_turn
from baselines.volumetric.rays.photographs import as_seen, rays_of_the_mean, small_pictures
from baselines.volumetric.rays.rays import WorldRays, camera_rays, depth_range
from baselines.volumetric.rays.spaces import NDC, Contracted, choose_space, contract, expand, space_from
from hydroviews.errors import InputError
from hydroviews.scene.cameras import Camera
from hydroviews.scene.scenes import Points, no_points
from hydroviews.scene.seeds import generator

CPU = torch.device("cpu")


def forward_cameras(n: int = 5) -> list[Camera]:
    """Side by side, turned a little, looking along +z."""
    cameras = []
    for index in range(n):
        turn = 0.05 * (index - n // 2)
        pose = np.eye(4)
        pose[:3, :3] = [[np.cos(turn), 0, -np.sin(turn)], [0, 1, 0], [np.sin(turn), 0, np.cos(turn)]]
        pose[:3, 3] = -pose[:3, :3] @ [0.3 * (index - n // 2), 0.1 * index, 0.05 * index]
        cameras.append(Camera(40, 30, 36.0, 38.0, 20.5, 14.0, pose))
    return cameras


def points_at(depths, n=50) -> Points:
    generator = np.random.default_rng(0)
    parts = [np.column_stack([generator.uniform(-0.1, 0.1, (n, 2)) * d, np.full(n, d)]) for d in depths]
    return Points(np.concatenate(parts), np.zeros((n * len(depths), 3), np.uint8))


ALL_ROUND = [camera(20, 15, angle) for angle in np.linspace(0, 6, 9)]


def test_points_on_rays_project_onto_pixel_centres_at_their_depth():
    view = replace(camera(7, 5), fx=6.0, fy=9.0, cx=3.1, cy=2.7)
    rays, depths = camera_rays(view), np.random.default_rng(0).uniform(0.5, 9, 35)
    pixels, found = view.project(rays.origins + depths[:, None] * rays.directions)
    rows, columns = np.mgrid[:5, :7] + 0.5
    np.testing.assert_allclose(pixels, np.stack([columns.ravel(), rows.ravel()], 1), atol=1e-9)
    np.testing.assert_allclose(found, depths)


def test_depths_of_visible_points_bound_the_range():
    cameras = [Camera(40, 30, 36.0, 36.0, 20.0, 15.0, np.eye(4))]
    assert depth_range(cameras, points_at([2.0, 5.0, 9.0]), 1.0) == pytest.approx((2, 9))
    behind = Points(-points_at([2.0]).positions, np.zeros((50, 3), np.uint8))
    assert depth_range(cameras, behind, 3.0) == pytest.approx((0.3, 30))  # nothing seen
    assert depth_range(cameras, no_points(), 3.0) == pytest.approx((0.3, 30))
    stray = points_at([5.0] * 40 + [1e-5], 50)  # a camera among the points: more than a permille is that near
    assert depth_range(cameras, stray, 1.0)[0] == pytest.approx(0.05)


def test_contraction_and_its_inverse():
    points = torch.from_numpy(np.random.default_rng(0).normal(size=(500, 3)) * np.logspace(-2, 3, 500)[:, None])
    np.testing.assert_allclose(expand(contract(points)), points, rtol=1e-9)
    assert contract(points).norm(dim=1).max() < 2


def test_device_coordinates_are_those_of_projected_points():
    cameras = forward_cameras()
    space = choose_space(cameras, points_at([3.0, 8.0]), "auto")
    assert isinstance(space, NDC)
    rays = camera_rays(cameras[1])
    local = rays.origins[:, None] + np.array([4.0, 10, 1e3])[:, None] * rays.directions[:, None]
    mean = Camera(2, 2, 1 / space.slopes[0], 1 / space.slopes[1], 0, 0, np.array(space.pose))
    pixels, z = mean.project(local.reshape(-1, 3))
    known = np.column_stack([pixels, 1 - 2 * space.near / z]).reshape(-1, 3, 3)
    t = (known[..., 2] + 1) / 2  # z runs evenly from -1 at the near plane to 1
    found = space.from_world(rays, CPU).points(torch.from_numpy(t.astype(np.float32)))
    np.testing.assert_allclose(found, known, atol=2e-6)


def test_every_training_ray_stays_in_the_cube():
    space = choose_space(forward_cameras(), points_at([3.0, 8.0]), "ndc")
    for view in forward_cameras():
        rays = space.from_world(camera_rays(view), CPU)
        inside = space.to_unit_cube(rays.points(torch.linspace(0, 1, 5).expand(len(rays.origins), -1)))
        assert -1e-6 < inside.min() < inside.max() < 1 + 1e-6


def test_cameras_all_round_are_contracted_into_the_unit_ball():
    space = choose_space(ALL_ROUND, points_at([0.5], 100), "auto")
    assert isinstance(space, Contracted)
    rays = space.from_world(camera_rays(ALL_ROUND[0]), CPU)
    assert rays.origins.norm(dim=1).max() < 1
    assert torch.allclose(rays.viewing.norm(dim=1), torch.ones(300))
    t = space.s_to_t(torch.tensor([0.0, 0.5, 1.0]))
    np.testing.assert_allclose(t, [space.near, np.sqrt(space.near * space.far), space.far], rtol=1e-5)


@pytest.mark.parametrize("kind", ["contracted", "ndc"])
def test_a_space_comes_back_from_what_is_written_of_it(kind):
    space = choose_space(forward_cameras(), points_at([3.0]), kind)
    assert space_from(space.settings()) == space


@pytest.mark.parametrize(
    ("cameras", "kind", "message"),
    [(ALL_ROUND, "ndc", "look every way"), (ALL_ROUND, "flat", "unknown"), ([], "auto", "no training views")],
)
def test_what_cannot_be_a_space_is_refused(cameras, kind, message):
    with pytest.raises(InputError, match=message):
        choose_space(cameras, no_points(), kind)


def test_rays_that_look_backwards_are_refused():
    space = choose_space(forward_cameras(), points_at([3.0]), "ndc")
    with pytest.raises(InputError, match="backwards"):
        space.from_world(WorldRays(np.zeros((1, 3)), np.array([[0, 0, -1.0]])), CPU)


@pytest.mark.parametrize(("height", "width"), [(24, 32), (5, 90)])
def test_grids_stay_inside_and_reach_every_pixel(height, width):
    met, random = np.zeros((height, width), int), np.random.default_rng(0)
    for _ in range(2000):
        rows, columns = grid(height, width, 8, 0.5, random)
        assert min(rows.min(), columns.min()) >= 0
        met[rows, columns] += 1  # out of range would raise
    assert met.min() > 0


def test_grids_are_regular_and_as_large_as_was_said():
    random, spans = np.random.default_rng(1), []
    for _ in range(300):
        rows, columns = grid(1000, 2000, 11, 0.5, random).reshape(2, 11, 11)
        assert (rows == rows[:, :1]).all()
        assert (columns == columns[:1]).all()
        across, down = np.diff(columns[0]), np.diff(rows[:, 0])
        assert max(np.ptp(across), np.ptp(down)) <= 1
        assert abs(down.mean() / 1000 - across.mean() / 2000) < 2e-4  # one share of both sides
        spans.append(across.sum() / 2000 / (10 / 11))
    assert 0.49 < min(spans) < 0.52
    assert 0.98 < max(spans) < 1.01


@pytest.mark.parametrize(("photographs", "views"), [(1, 7), (4, 7), (3, 1)])
def test_views_come_in_turn(photographs, views):
    steps, others = (
        np.stack([views_in_turn(seed, iteration, photographs, views) for iteration in range(views)]) for seed in (3, 4)
    )
    assert steps.shape == (views, photographs)
    assert (np.bincount(steps.ravel(), minlength=views) == photographs).all()
    assert views == 1 or not np.array_equal(steps, others)


def test_a_step_has_the_pixels_of_its_photograph(tmp_path):
    scene = balls.photographed(tmp_path, n_views=6)
    cameras = [view.camera for view in scene.train_views]
    pixels, space = TrainingPixels(cameras, read_images(scene.train_views)), Contracted((0.0, 0.0, 0.0), 1.0, 0.2, 5.0)
    batch = grids(4, 8)(pixels, 0, 5, 256, space, CPU)
    views, random = views_in_turn(0, 5, 4, len(cameras)), generator(0, "grid", 5)
    assert batch.views.tolist() == np.repeat(views, 64).tolist()
    for part, view in enumerate(views):
        rows, columns = grid(24, 32, 8, 0.5, random)
        here = slice(64 * part, 64 * part + 64)
        np.testing.assert_allclose(batch.colours[here], scene.train_views[view].image()[rows, columns], atol=1e-6)
        places = np.stack([(rows + 0.5) / 24, (columns + 0.5) / 32], 1)
        np.testing.assert_allclose(batch.places[here], places, rtol=1e-6)
        exact = camera_rays(cameras[view]).directions.reshape(24, 32, 3)[rows, columns]
        exact = exact / np.linalg.norm(exact, axis=1, keepdims=True)
        np.testing.assert_allclose(batch.rays.viewing[here], exact, atol=1e-6)


def test_rays_that_make_no_square_are_refused():
    assert side_of_grids(256, 4) == 8
    for photographs in (0, 2, 300):
        with pytest.raises(ValueError, match=f"256 rays a step in {photographs} photographs"):
            side_of_grids(256, photographs)


def test_what_is_hidden_of_a_picture_is_not_seen():
    hidden, looks = np.zeros((240, 320), bool), []
    hidden[:, 100:200] = True
    for value in (0, 255):
        picture = np.where(hidden[..., None], value, np.full(3, 100)).astype(np.uint8)
        looks.append(small_pictures(TrainingImages([picture], [hidden]), 16))
    assert torch.equal(*looks)
    assert looks[0].max() == 100
    np.testing.assert_allclose(as_seen(torch.tensor([0, 255], dtype=torch.uint8)), [-1, 1])


@pytest.mark.parametrize("share", [0.0, 0.25, 0.3, 0.5, 1.0])
def test_rays_of_the_mean_look_are_a_share_spread_evenly(share):
    chosen = rays_of_the_mean(1000, share, CPU)
    parts = chosen.view(10, 100).sum(1)
    assert abs(int(chosen.sum()) - 1000 * share) <= 1
    assert int(parts.max() - parts.min()) <= 1
