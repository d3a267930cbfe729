"""The example of a method of one's own: it keeps the contract, and does what it says."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from baselines.method import find_method
from hydroviews.errors import InputError
from hydroviews.metrics import psnr
from hydroviews.scene.images import write_png
from hydroviews.scene.scenes import no_points
from leaderboard.contract.case import Case
from leaderboard.contract.toy_scene import draw_room
from leaderboard.contract.trials import CHECKS, Result, try_check
from leaderboard.runs.train_and_render import only_training

REPOSITORY = Path(__file__).parents[2]
MANY = 40  # views, as close to one another as those of a capture
NAME = "examples.median_view:MedianView"
WITHOUT_CHECKPOINT = {"fitted twice", "other checkpoints refused", "Ctrl-C and on", "SIGTERM and on"}


@pytest.fixture
def kind(monkeypatch):
    """The class, found from the repository as the documentation says."""
    monkeypatch.chdir(REPOSITORY)
    return find_method(NAME)


def fitted(kind, scene, folder):
    method = kind(kind.configuration("demo"), 0)
    method.fit(only_training(scene), folder)
    return method


def test_it_keeps_the_contract(kind, tmp_path):
    case = Case(NAME, kind, "demo", 10, tmp_path)
    outcomes = {name: try_check(case, name, CHECKS[name]) for name in set(CHECKS) - WITHOUT_CHECKPOINT}
    assert {outcome.result for outcome in outcomes.values()} == {Result.PASSED}, outcomes


def test_held_out_views_of_a_room_are_seen_in_the_photographs(kind, tmp_path):
    scene = draw_room(tmp_path, n_views=MANY)
    method = fitted(kind, scene, tmp_path)
    for view in scene.test_views:
        beside = min(scene.train_views, key=lambda v: np.linalg.norm(v.camera.centre - view.camera.centre))
        found = psnr(method.render(view.camera), view.image())
        assert found > 22
        assert found > psnr(beside.image(), view.image()) + 5


def test_what_only_one_photograph_shows_is_left_out(kind, tmp_path):
    wet = draw_room(tmp_path, n_views=MANY)
    view = wet.train_views[MANY // 2]
    clean, drop = view.image(), np.s_[12:24, 16:32]
    rainy = clean.copy()
    rainy[drop] = 1
    write_png(view.path, rainy)
    errors = {}
    for photographs in (1, 5):
        method = kind(replace(kind.configuration("demo"), photographs=photographs), 0)
        method.fit(only_training(wet), tmp_path)
        errors[photographs] = np.abs(method.render(view.camera) - clean)[drop].mean()
    assert errors[1] > 0.8 * np.abs(rainy - clean)[drop].mean()
    assert errors[5] < 0.2 * errors[1]


def test_without_points_there_is_no_telling_how_far_away_things_are(kind, tmp_path):
    with pytest.raises(InputError, match="room: no points"):
        fitted(kind, replace(draw_room(tmp_path), points=no_points()), tmp_path)
