"""Initial Gaussians, growth and pruning; the random numbers that they draw; points that are put between others."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.spatial import cKDTree
from splats import camera, cloud, photographed, with_values
from trainings import CONFIG, assert_identical, crashed_and_resumed

from baselines.splatting.schedule import LearningRates, Stream, random_stream, rates_at, sh_degree_at, view_at
from baselines.splatting.state import fresh_state
from baselines.splatting.strategies.densification import (
    DefaultStrategy,
    grow,
    grow_due,
    observe,
    reset_due,
    reset_opacity,
    rotation_matrices,
    split_up,
)
from baselines.splatting.strategies.initialisation import BETWEEN, MIDDLE, filled_up, initialise, scene_extent
from baselines.splatting.trainer import train
from hydroviews.scene.scenes import Points, no_points

CAMERAS = [camera(10, 10, angle) for angle in (0, 2, 4)]


def grown(gradients, strategy=DefaultStrategy(), **rows):  # noqa: B008 (frozen)
    """Small half-transparent Gaussians with these gradients, before and after growth; `rows` are changed first."""
    n = len(gradients)
    gaussians = replace(cloud(n, 1), opacity_logits=np.zeros(n, np.float32))
    gaussians = with_values(gaussians, "log_scales", slice(None), np.log(0.001))
    for name, (row, value) in rows.items():
        gaussians = with_values(gaussians, name, row, value)
    state = fresh_state(gaussians)
    state.gradient_sum[:], state.seen[:] = gradients, 1
    return gaussians, grow(state, strategy, 1.0, np.random.default_rng(0))


def test_small_gaussians_are_cloned_large_ones_split_and_transparent_and_oversized_ones_removed():
    before, after = grown(np.isin(np.arange(10), [2, 7]), log_scales=(7, np.log(0.05)))
    assert len(after.gaussians) == 12  # one more for number 2; two for number 7, which is gone
    assert np.array_equal(after.gaussians.means[-3], before.means[2])
    assert np.allclose(after.gaussians.log_scales[-2:], np.log(0.05 / 1.6))
    assert not after.gradient_sum.any()
    assert len(after.first.means) == 12
    before, after = grown(np.zeros(10), opacity_logits=(0, -10), log_scales=(1, np.log(0.2)))
    assert np.array_equal(after.gaussians.means, before.means[2:])


@pytest.mark.parametrize(
    ("budget", "growth", "gradient", "expected"),
    [
        (107, 1.0, np.arange(100), 107),
        (1000, 0.1, np.arange(100), 110),
        (50, 1.0, np.arange(100), 100),
        (1000, 1.0, np.full(100, 1e-5), 100),
        (1000, 1.0, np.zeros(0), 0),
    ],
    ids=["up to the budget", "by a share", "above the budget already", "no gradient", "nothing there"],
)
def test_growth_stops_at_the_budget_and_takes_the_largest_gradients(budget, growth, gradient, expected):
    before, after = grown(gradient, DefaultStrategy(budget=budget, growth=growth))
    added = expected - len(before)
    assert len(after.gaussians) == expected
    assert np.array_equal(after.gaussians.means[len(before) :], before.means[len(before) - added :])


def test_observed_gradients_are_by_half_the_image_size():
    state = fresh_state(cloud(4, 0))
    means2d = np.array([[3e-3, 0], [1, 1], [0, 4e-3], [3e-3, 4e-3]], np.float32)
    observe(state, np.array([True, False, True, True]), means2d, (200, 100))
    assert np.allclose(state.gradient_sum, [0.3, 0, 0.2, np.hypot(0.3, 0.2)])
    assert np.array_equal(state.seen, [1, 0, 1, 1])


def test_split_positions_follow_the_shape():
    one = cloud(1, 0).map(lambda value: np.repeat(value, 20_000, axis=0))
    offsets = (split_up(one, np.random.default_rng(0)).means - one.means[0]).astype(np.float64)
    axes = rotation_matrices(one.quaternions[:1])[0] * np.exp(one.log_scales[0])
    expected = axes @ axes.T
    assert np.abs(np.cov(offsets.T) - expected).max() < 0.05 * np.abs(expected).max()


def test_opacity_reset():
    state = fresh_state(cloud(50, 0))
    state.first.opacity_logits[:] = 1
    after = reset_opacity(state, DefaultStrategy())
    assert (1 / (1 + np.exp(-after.gaussians.opacity_logits)) <= 0.0100001).all()
    assert not after.first.opacity_logits.any()


def test_when_things_are_due():
    strategy = DefaultStrategy(start=500, stop=1000, every=100, reset_every=300)
    assert [i + 1 for i in range(2000) if grow_due(strategy, i)] == [500, 600, 700, 800, 900]
    assert [i + 1 for i in range(2000) if reset_due(strategy, i)] == [300, 600, 900]
    assert [i + 1 for i in range(2000) if strategy.due(i)] == [300, 500, 600, 700, 800, 900]  # theirs: 600, not 500
    assert not any(reset_due(replace(strategy, reset_every=None), i) for i in range(2000))


def test_initial_gaussians_sit_on_the_points():
    grid = np.stack(np.meshgrid(*[np.arange(6.0)] * 3), -1).reshape(-1, 3)
    colours = np.random.default_rng(0).integers(0, 256, grid.shape, np.uint8)
    gaussians, fine = (initialise(Points(places, colours), CAMERAS, 2, 0) for places in (grid, grid / 100))
    assert np.allclose(gaussians.means, grid)
    assert np.allclose(np.exp(gaussians.log_scales), 0.05 * scene_extent(CAMERAS, grid)[1])
    assert np.allclose(np.exp(fine.log_scales), 0.01)
    assert np.allclose(0.5 + 0.28209479 * gaussians.sh[:, 0], colours / 255, atol=1e-6)
    assert np.allclose(1 / (1 + np.exp(-gaussians.opacity_logits)), 0.1)


def test_without_points_gaussians_are_drawn_around_the_cameras():
    one, two, other = (initialise(no_points(), CAMERAS, 0, seed) for seed in (0, 0, 1))
    assert len(one) == 10_000
    assert np.array_equal(one.means, two.means)
    assert not np.array_equal(one.means, other.means)


def test_impossible_points_are_left_out_and_told(caplog):
    positions = np.random.default_rng(0).uniform(-1, 1, (150, 3))
    positions[:40, 1], positions[40:60, 2] = np.nan, 1e308
    gaussians = initialise(Points(positions, np.zeros((150, 3), np.uint8)), CAMERAS, 0, 0)
    assert np.isfinite(gaussians.means).all()
    assert len(gaussians) == 90 + 10_000
    assert "60 of 150 points left out" in caplog.text
    assert "90 points are few: 10000 random ones are added" in caplog.text


def test_a_far_scene_is_recentred():
    offset = np.array([1e6, 2e6, -3e6])
    points = np.random.default_rng(0).uniform(-1, 1, (200, 3))
    cameras = [camera(10, 10, a, tuple(offset)) for a in (0, 2, 4)]
    gaussians = initialise(Points(points + offset, np.zeros((200, 3), np.uint8)), cameras, 0, 0)
    assert np.abs(gaussians.means + (gaussians.origin - offset) - points).max() < 1e-6


@pytest.mark.parametrize("scale", [0.001, 1.0, 1000.0])
def test_cameras_in_one_place_have_an_extent_in_the_units_of_the_points(scale):
    """A fixed one would put `near` behind a small scene, and that of a tripod's jitter make Gaussians tiny."""
    points = np.random.default_rng(0).uniform(-1, 1, (150, 3))
    points[0], points[1] = 1e300, np.nan
    tripod = [camera(10, 10, a, (a * 1e-4, 0, 0)) for a in (0, 0.0001, 0.0002)]

    def extent(cameras, positions=points):
        poses = [one.world_to_camera.copy() for one in cameras]
        for pose in poses:
            pose[:3, 3] *= scale
        moved = [replace(one, world_to_camera=pose) for one, pose in zip(cameras, poses, strict=True)]
        return scene_extent(moved, scale * positions)[1] / scale

    assert extent(CAMERAS[:1]) == pytest.approx(1, rel=0.1)  # they look at the points from four units away
    assert extent(tripod) == pytest.approx(1, rel=0.1)
    assert extent(CAMERAS) == extent(CAMERAS, no_points().positions) > 4  # others are what they are without points
    assert extent(CAMERAS[:1], points[:50]) == 1 / scale


def test_schedule():
    order = [view_at(i, 10, seed=1) for i in range(30)]
    assert all(sorted(order[k : k + 10]) == list(range(10)) for k in (0, 10, 20))
    assert order[:10] != order[10:20]
    assert [sh_degree_at(i, 100, 3) for i in (0, 99, 100, 250, 1000)] == [0, 0, 1, 2, 3]  # theirs: 1 at 99
    first, last = (rates_at(i, 100, LearningRates(final=0.1), 5.0, 1) for i in (0, 100))
    assert (first["means"], last["means"]) == pytest.approx((5 * 1.6e-4, 5 * 1.6e-6))
    assert last["opacity_logits"] == pytest.approx(0.005)
    assert first["sh"][0, 0] == pytest.approx(20 * first["sh"][1, 0])


@pytest.mark.parametrize(("iteration", "factor"), [(0, 1), (40, 1), (80, 1), (90, 0.1**0.5), (100, 0.1)])
def test_all_rates_fall_faster_in_the_end(iteration, factor):
    usual = LearningRates(final=0.5)
    expected, found = (rates_at(iteration, 100, rates, 5.0, 1) for rates in (usual, replace(usual, cooldown=0.2)))
    assert expected.keys() == found.keys()
    for name, value in found.items():
        assert np.allclose(value, factor * np.asarray(expected[name]), rtol=1e-5, atol=0), name


NAMES = ["VIEW_ORDER", "SPLITTING", "RELOCATION", "NOISE", "DROPOUT", "ABSENCE", "INLIERS", "LAYERS", "START"]


@pytest.mark.parametrize(("number", "name"), list(enumerate(NAMES, 1)))
def test_numbers_are_those_of_earlier_runs(number, name):
    for seed, index in ((0, 7), (3, 5)):
        expected = np.random.default_rng((seed, number, index)).random()
        assert random_stream(seed, Stream[name], index).random() == expected


def cloud_of(n):
    rng = np.random.default_rng(0)
    return Points(rng.uniform(-1, 1, (n, 3)), rng.integers(0, 256, (n, 3), np.uint8))


def test_new_points_lie_between_neighbours_in_a_colour_between_theirs():
    points = cloud_of(150)
    known, colours = points.positions, points.colours / 255
    positions, new_colours = filled_up(known, colours, 400, np.random.default_rng(1))
    assert positions.shape == new_colours.shape == (400, 3)
    assert np.array_equal(positions[:150], known)
    assert np.array_equal(new_colours[:150], colours)
    near = cKDTree(known).query(known, BETWEEN + 1)[1][:, 1:]
    firsts, seconds = np.repeat(np.arange(150), BETWEEN), near.ravel()
    along, used = known[seconds] - known[firsts], set()
    for position, colour in zip(positions[150:], new_colours[150:], strict=True):
        way = ((position - known[firsts]) * along).sum(axis=1) / (along**2).sum(axis=1)
        apart = np.linalg.norm(known[firsts] + way[:, None] * along - position, axis=1)
        between = np.flatnonzero((apart < 1e-9) & (way >= MIDDLE[0]) & (way <= MIDDLE[1]))
        pair = between[0]
        assert np.allclose(colour, (1 - way[pair]) * colours[firsts[pair]] + way[pair] * colours[seconds[pair]])
        used.update(firsts[between])
    assert len(used) == 150  # 250 of 150 points: every one of them


def test_a_start_is_filled_up_from_the_seed():
    points = cloud_of(150)
    start = partial(initialise, points, CAMERAS, 1)
    plain, one, two, other = start(0), start(0, 500), start(0, 500), start(1, 500)
    assert (len(plain), len(one)) == (150, 500)
    assert np.array_equal(one.means[:150], plain.means)
    assert np.array_equal(one.means, two.means)
    assert not np.array_equal(one.means, other.means)
    generator = random_stream(0, Stream.START, 0)
    assert np.allclose(one.means, filled_up(points.positions, points.colours / 255, 500, generator)[0], atol=1e-6)
    # as large as the distance to their neighbours, which are nearer now
    assert one.log_scales[:150].mean() < plain.log_scales.mean()


def test_a_cloud_above_the_budget_is_thinned_evenly_and_said_so(caplog):
    rng = np.random.default_rng(0)
    crowded = rng.normal(0.5, 0.2, (12_000, 3))  # a scanner stood there
    positions = np.concatenate([rng.uniform(-1, 1, (8_000, 3)), crowded, [[1e5, 0, -1e5]]])
    points = Points(positions, rng.integers(0, 256, (len(positions), 3), np.uint8))
    start, again = (initialise(points, CAMERAS, 1, 0, budget=5_000) for _ in range(2))
    assert len(start) == 3_000  # growth has the other two fifths
    assert "20,001 points are more than the budget of 5,000 Gaussians" in caplog.text
    assert "the cloud is thinned evenly to 3,000" in caplog.text
    assert np.array_equal(start.means, again.means)
    after, before = (np.bincount((p > 0) @ [1, 2, 4], minlength=8) / len(p) for p in (start.means, positions))
    assert np.abs(after - before).max() < 0.01  # in each eighth of the cube
    gaps = cKDTree(start.means).query(positions)[0]
    random = cKDTree(positions[rng.permutation(20_001)[:3_000]]).query(positions)[0]
    assert np.quantile(gaps, 0.99) < np.quantile(random, 0.99)  # no holes, as a sample has them


def test_a_cloud_within_the_budget_keeps_its_bits_and_random_points_keep_to_it_too():
    within, plain = (initialise(cloud_of(150), CAMERAS, 1, 0, budget=budget).state_dict() for budget in (150, None))
    assert all(np.array_equal(within[name], value) for name, value in plain.items())
    assert len(initialise(cloud_of(90), CAMERAS, 1, 0, budget=1_000)) == 600


def test_a_training_starts_with_a_share_of_its_budget_and_resumes_exactly(tmp_path):
    scene = replace(photographed(tmp_path, 8, 50, 38), points=cloud_of(120))
    config = replace(CONFIG, dense_start=0.75, strategy=replace(CONFIG.strategy, budget=200, start=40))
    assert len(train(scene, replace(config, iterations=1), 0, tmp_path / "first").gaussians) == 150
    whole = train(scene, config, 0, tmp_path / "whole")
    assert_identical(whole, crashed_and_resumed(scene, config, 90, tmp_path / "cut"))
