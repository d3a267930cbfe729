"""Pairs that contradict the order in time are found, right ones stay."""

import numpy as np
import pycolmap
import pytest
from scipy.spatial.transform import Rotation

from hydroviews.captures.sfm.features import image_id
from hydroviews.captures.sfm.sequence import contradictions, leave_out_contradictions

VIEWS, STEP = 20, 9.0  # degrees between views


def turn(degrees):
    return Rotation.from_euler("y", degrees, degrees=True).as_matrix()


def walk(error=0.0):
    """Right pairs of views at most six apart, each of which turns too far by a share of its turn."""
    return {
        (i, j): (turn((1 + error) * STEP * (j - i)), 200 - 20 * (j - i))
        for i in range(VIEWS)
        for j in range(i + 1, min(VIEWS, i + 7))
    }


@pytest.mark.parametrize("error", [0.0, 0.2])
def test_right_pairs_stay(error):
    """Also those of a loop that closes, and where turns are measured too large by a wrong focal length."""
    loop = {(0, VIEWS - 1): (turn(STEP * (VIEWS - 1)), 60)}
    assert contradictions(VIEWS, walk(error) | loop) == []


ALIKE = {(i, i + 10): (np.eye(3), 150) for i in range(6)}  # four sides of a square that look alike


@pytest.mark.parametrize("wrong", [ALIKE, {(4, 6): (turn(-90), 30)}], ids=["alike", "neighbours with few matches"])
def test_wrong_pairs_are_left_out(wrong):
    assert contradictions(VIEWS, walk() | wrong) == sorted(wrong)


def test_right_pairs_stay_where_the_order_jumps():
    """Neighbours across a jump are matched wrongly, each in another way: views that are farther apart connect both."""
    turns = Rotation.random(6, random_state=0).as_matrix()
    across = [(i, j) for i in (7, 8, 9) for j in (10, 11, 12) if j - i <= 3]
    jump = {pair: (rotation, 300) for pair, rotation in zip(across, turns, strict=True)}
    far = {(i, i + 10): (turn(STEP * 3), 60) for i in range(5)}
    sides = {pair: found for pair, found in walk().items() if (pair[0] < 10) == (pair[1] < 10)}
    wrong = {(1, 6): (turn(-90), 80)}
    assert sorted(contradictions(VIEWS, sides | jump | far | wrong)) == sorted(wrong | jump)


def test_views_that_no_neighbours_connect_are_not_judged():
    pairs = {(0, 1): (turn(STEP), 100), (10, 11): (turn(STEP), 100), (0, 10): (turn(150), 100)}
    assert contradictions(VIEWS, pairs) == []
    assert contradictions(3, {}) == []


def test_matches_of_contradictions_are_removed(tmp_path):
    """In a database of views around a sphere, of which the last is given the matches of another place."""
    pycolmap.set_random_seed(0)
    size = {"num_rigs": 1, "num_cameras_per_rig": 1, "num_frames_per_rig": 6, "num_points3D": 200}
    with pycolmap.Database.open(tmp_path / "d.db") as opened:
        model = pycolmap.synthesize_dataset(pycolmap.SyntheticDatasetOptions(**size), opened)
        names = sorted(model.images[image].name for image in model.reg_image_ids())
        ids = [image_id(opened, name) for name in names]
        swapped = opened.read_two_view_geometry(ids[0], ids[1])
        opened.delete_two_view_geometry(ids[0], ids[5])
        opened.write_two_view_geometry(ids[0], ids[5], swapped)
    leave_out_contradictions(tmp_path / "d.db", names)
    with pycolmap.Database.open(tmp_path / "d.db") as opened:
        kept = [opened.exists_two_view_geometry(ids[0], other) for other in ids[1:]]
    assert kept == [True] * 4 + [False]
