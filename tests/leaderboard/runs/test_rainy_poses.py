import shutil
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from captures import WALK, capture
from random_cameras import rotations

from hydroviews.captures.sfm.mapping import TooFewRegistered
from hydroviews.dataset.sources import build_source
from hydroviews.dataset.variants import open_clean
from hydroviews.errors import InputError
from hydroviews.formats.read import read_scene
from hydroviews.formats.writers import write_colmap
from hydroviews.profiles import find_profile
from hydroviews.scene.alignment import Similarity
from hydroviews.scene.images import resize_area, write_png
from hydroviews.scene.scenes import Points, View, make_scene
from leaderboard.evaluate import carry_out, evaluate
from leaderboard.runs import estimated_cameras
from leaderboard.runs.run import Run
from leaderboard.runs.supervision import Limits

pytestmark = pytest.mark.usefixtures("toys", "trained_here")

ELSEWHERE = Similarity(0.3, rotations(np.random.default_rng(1), 1)[0], np.array([5.0, -2.0, 1.0]))
LONGER = 1.02  # estimated over true focal length


@pytest.fixture
def built(evaluated_once, tmp_path):
    """A folder with built data, and no results."""
    shutil.copytree(evaluated_once[0] / "data", tmp_path / "data")
    return tmp_path


@pytest.fixture
def outcome(built, request_of):
    """The record of a toy method in this track."""
    return lambda method="MeanColour": evaluate(request_of(method, track="rainy-poses"))[-1]


def run_of(built: Path, method: str = "MeanColour", pattern: str = "streak-0") -> Run:
    name = f"toy_methods:{method}"
    return Run(name, "demo", 0, built / "data/demo", "yard", pattern, built / "results", "rainy-poses")


def pretend(built: Path, monkeypatch, registered: int, move=lambda pose: ELSEWHERE.poses(pose), begun=lambda: None):
    """Let the first few photographs get their true cameras in another world, of longer focal length; counts calls."""
    calls = []

    def estimate(images, out, camera_model, **options):
        calls.append((images, options))
        begun()
        true = open_clean(built / "data/demo/yard").train_views
        files = sorted(images.iterdir())
        assert len(files) == len(true)
        if registered < 3:
            raise TooFewRegistered(images, registered, len(files), "take more")
        cameras = [replace(view.camera, fx=view.camera.fx * LONGER, fy=view.camera.fy * LONGER) for view in true]
        cameras = [replace(camera, world_to_camera=move(camera.world_to_camera)) for camera in cameras]
        views = [View(file.stem, camera, file) for file, camera in zip(files, cameras, strict=True)][:registered]
        points = Points(ELSEWHERE.points(np.eye(3)), np.full((3, 3), 7, np.uint8))
        return make_scene("capture", views, points)

    monkeypatch.setattr(estimated_cameras, "estimate_poses", estimate)
    return calls


def test_trains_on_registered_views_in_the_clean_world_and_scores_all_held_out_ones(built, outcome, monkeypatch):
    calls = pretend(built, monkeypatch, registered=5)
    record = outcome()
    assert (record.status, record.track, record.n_train, record.n_test) == ("done", "rainy-poses", 5, 2)
    assert (record.registered, record.photographs) == (5, 7)
    errors = (record.pose_auc_5, record.rotation_error, record.position_error)
    assert errors == pytest.approx((10 / 21, 0, 0), abs=1e-6)
    assert calls[-1][1]["rainy"]

    true, seen = open_clean(built / "data/demo/yard"), run_of(built).training_scene()
    assert [view.name for view in seen.train_views] == [view.name for view in true.train_views[:5]]
    true_views = {view.name: view for view in true.views}
    for found in seen.views:
        wanted = true_views[found.name].camera
        np.testing.assert_allclose(found.camera.world_to_camera, wanted.world_to_camera, atol=1e-9)
        longer = (LONGER * wanted.fx, LONGER * wanted.fy)  # the held-out ones' as well
        assert (found.camera.fx, found.camera.fy) == pytest.approx(longer)
    np.testing.assert_allclose(seen.points.positions, np.eye(3), atol=1e-9)

    row = pd.read_csv(built / "results/leaderboard.csv").query("pattern == 'streak-0'").iloc[-1]
    assert (row.track, row.registered, row.photographs) == ("rainy-poses", 5, 7)


def test_a_method_is_lent_estimated_cameras_and_no_others(built, monkeypatch):
    pretend(built, monkeypatch, registered=5)
    run = run_of(built)
    run.estimate()
    with run.lent() as (lent, loan):
        files = {path.relative_to(loan.data / "yard").as_posix() for path in loan.files}
        assert len([name for name in files if name.startswith("streak-0/images/")]) == 5
        folders = (loan.data / "yard", run.cameras, run.data / "yard")
        cameras, estimated, true = ((folder / "sparse/0/cameras.bin").read_bytes() for folder in folders)
        assert cameras == estimated != true
        seen, wanted = lent.training_scene(), run.training_scene()
        assert [view.name for view in seen.views] == [view.name for view in wanted.views]
        assert not loan.spoilt()


def test_methods_share_cameras_and_clean_views_have_their_own(built, outcome, monkeypatch):
    calls = pretend(built, monkeypatch, registered=7)
    outcome()
    rainy = {images.parent.parent.name: options["rainy"] for images, options in calls}
    assert rainy == {"clean": False, "streak-0": True}  # the ceiling's, the floor's
    outcome("Raises")
    assert len(calls) == 2


def test_two_evaluations_at_once_estimate_once(built, monkeypatch):
    begun, both = [], threading.Barrier(2)

    def start():
        begun.append(threading.get_ident())
        both.wait(0.5) if len(begun) > 1 else None  # passes only if both are in here

    calls = pretend(built, monkeypatch, registered=7, begun=start)
    run = run_of(built)
    with ThreadPoolExecutor(2) as pool:
        first, second = pool.map(lambda _: run.estimate(), range(2))
    assert first == second
    assert len(calls) == 1


def test_goes_on_after_an_interruption(built, outcome, monkeypatch):
    def stop():
        raise KeyboardInterrupt

    pretend(built, monkeypatch, registered=7, begun=stop)
    with pytest.raises(KeyboardInterrupt):
        outcome()
    cameras = run_of(built, pattern="clean").cameras
    linked = sorted(path.name for path in (cameras / "photographs").iterdir())
    assert not (cameras / "errors.json").exists()
    pretend(built, monkeypatch, registered=7)
    assert outcome().status == "done"
    assert sorted(path.name for path in (cameras / "photographs").iterdir()) == linked


@pytest.mark.parametrize(
    ("registered", "reason"),
    [(3, "3 of 7 photographs registered, fewer than 4"), (2, "only 2 of 7 photographs could be registered")],
)
def test_too_few_registered_views_are_a_failed_row_with_the_reason(built, outcome, monkeypatch, registered, reason):
    pretend(built, monkeypatch, registered=registered)
    record = outcome()
    assert record.status == "failed"
    assert reason in record.reason
    assert (record.registered, record.photographs, record.scores) == (registered, 7, {})
    row = pd.read_csv(built / "results/leaderboard.csv").iloc[-1]
    assert (row.status, row.registered) == ("failed", registered)
    with pytest.raises(InputError, match="no cameras to train on"):
        run_of(built).training_scene()


def test_cameras_that_cannot_be_aligned_are_a_failed_row(built, outcome, monkeypatch):
    in_one_place = lambda pose: np.hstack([pose[:, :3], np.eye(4)[:, 3:]])  # noqa: E731
    pretend(built, monkeypatch, registered=7, move=in_one_place)
    record = outcome()
    assert (record.status, record.registered, record.rotation_error) == ("failed", 7, None)
    assert "in one place" in record.reason


def test_photographs_of_a_flower_in_rain(tmp_path):
    """The whole way once, with photographs that register."""
    solved = read_scene(capture("llff_flower"))
    views = []
    for i in WALK:
        path = tmp_path / "walk/images" / f"{solved.views[i].name}.png"
        write_png(path, resize_area(solved.views[i].image(), 240, 180))
        views.append(replace(solved.views[i], path=path, lens=None, camera=solved.views[i].camera.resized(240, 180)))
    write_colmap(make_scene("walk", views, solved.points), tmp_path / "walk/sparse/0")
    build_source(str(tmp_path / "walk"), tmp_path / "data/demo", find_profile("demo"), patterns=("streak-0",))
    record = carry_out(replace(run_of(tmp_path), scene="walk"), Limits(time=1, stall=1))
    assert (record.status, record.photographs, record.registered) == ("done", 7, 7)
    assert record.pose_auc_10 > 0.6
    assert record.rotation_error < 1
