"""Points that are put between those of the capture before training."""

from dataclasses import replace
from functools import partial

import numpy as np
from scipy.spatial import cKDTree
from splats import camera, photographed
from trainings import CONFIG, assert_identical, crashed_and_resumed

from baselines.splatting.schedule import Stream, random_stream
from baselines.splatting.strategies.initialisation import BETWEEN, MIDDLE, filled_up, initialise
from baselines.splatting.trainer import train
from hydroviews.scene.scenes import Points

CAMERAS = [camera(10, 10, angle) for angle in (0, 2, 4)]


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
    along = known[seconds] - known[firsts]
    used = np.zeros(150, int)
    for position, colour in zip(positions[150:], new_colours[150:], strict=True):
        way = ((position - known[firsts]) * along).sum(axis=1) / (along**2).sum(axis=1)
        apart = np.linalg.norm(known[firsts] + way[:, None] * along - position, axis=1)
        between = np.flatnonzero((apart < 1e-9) & (way >= MIDDLE[0]) & (way <= MIDDLE[1]))
        assert len(between)
        pair = between[0]
        expected = (1 - way[pair]) * colours[firsts[pair]] + way[pair] * colours[seconds[pair]]
        assert np.allclose(colour, expected)
        used[firsts[between]] += 1
    assert (used > 0).all()  # 250 of 150 points: every one of them


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


def in_octants(positions):
    """How many of the points are in each eighth of the cube."""
    return np.bincount((positions > 0) @ [1, 2, 4], minlength=8)


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
    shares, before = in_octants(start.means) / 3_000, in_octants(positions) / 20_001
    assert np.abs(shares - before).max() < 0.01
    gaps = cKDTree(start.means).query(positions)[0]
    random = cKDTree(positions[rng.permutation(20_001)[:3_000]]).query(positions)[0]
    assert np.quantile(gaps, 0.99) < np.quantile(random, 0.99)  # no holes, as a sample has them


def test_a_cloud_within_the_budget_keeps_its_bits_and_random_points_keep_to_it_too():
    within, plain = (initialise(cloud_of(150), CAMERAS, 1, 0, budget=budget).state_dict() for budget in (150, None))
    assert all(np.array_equal(within[name], value) for name, value in plain.items())
    assert len(initialise(cloud_of(90), CAMERAS, 1, 0, budget=1_000)) == 600


def test_a_training_starts_with_a_share_of_its_budget_and_resumes_exactly(tmp_path):
    scene = photographed(tmp_path, 8, 50, 38)
    scene = replace(scene, points=cloud_of(120))
    config = replace(CONFIG, dense_start=0.75, strategy=replace(CONFIG.strategy, budget=200, start=40))
    unfinished = train(scene, replace(config, iterations=1), 0, tmp_path / "first")
    assert len(unfinished.gaussians) == 150
    whole = train(scene, config, 0, tmp_path / "whole")
    assert_identical(whole, crashed_and_resumed(scene, config, 90, tmp_path / "cut"))
