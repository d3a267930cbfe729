"""A score is of the data that the manifest lists, whatever a method or a disk does to files."""

import dataclasses
import errno
import re
import stat

import numpy as np
import pytest
from damage import contents, paint
from synthetic import capture_in

from hydroviews.dataset.build import build
from hydroviews.dataset.checks.verify import verify
from hydroviews.dataset.lending import lend
from hydroviews.dataset.manifest import data_hash
from hydroviews.dataset.variants import open_clean, open_variant
from hydroviews.errors import InputError
from hydroviews.files.atomic import write_json
from hydroviews.formats.read import read_scene
from hydroviews.formats.writers import write_colmap
from hydroviews.rain.patterns import Pattern
from hydroviews.scene.depth import depth_path, write_depth
from hydroviews.scene.masks import mask_name, write_ignored
from leaderboard.evaluate import evaluate
from leaderboard.runs.train_and_render import only_training
from leaderboard.scoring.score import score

pytestmark = pytest.mark.usefixtures("toys")


@pytest.mark.parametrize("method", ["Vandal", "VandalAtOnce"])
def test_a_method_that_writes_over_its_photographs_fails_and_harms_nobody(request_of, run, method):
    before = contents(run.data)
    record = evaluate(request_of(method))[-1]
    assert (record.status, record.scores) == ("failed", {})
    assert re.fullmatch(r"wrote into the data that it was lent: view-01\.png, view-02\.png.* and 2 more", record.reason)
    assert contents(run.data) == before
    assert not list(run.results.rglob(".partial-*"))


def test_a_method_finds_no_ground_truth_and_no_held_out_picture(request_of, run, evaluated):
    before = contents(run.data)
    record = evaluate(request_of("Forger"))[-1]
    assert contents(run.data) == before
    assert (record.status, record.scores) == ("done", evaluated.scores)
    assert verify(run.data) == []
    assert score(run) == evaluated


@pytest.mark.parametrize("track", ["given-poses", "sparse-views"])
def test_what_is_lent_is_the_scene_without_what_is_held_back(run, track):
    run = dataclasses.replace(run, track=track)
    whole = run.training_scene()
    with run.lent() as (lent, loan):
        scene = lent.training_scene()
        assert scene.split == whole.split
        assert (scene.points.positions == whole.points.positions).all()
        for mine, theirs in zip(scene.views, whole.views, strict=True):
            assert (mine.name, mine.camera.fx) == (theirs.name, theirs.camera.fx)
            assert (mine.camera.world_to_camera == theirs.camera.world_to_camera).all()
        for mine, theirs in zip(only_training(scene).views, only_training(whole).views, strict=True):
            assert (mine.image() == theirs.image()).all()
            assert stat.S_IMODE(mine.path.stat().st_mode) == 0o444
            assert not mine.path.samefile(theirs.path)
        for view in scene.test_views:
            with pytest.raises(InputError, match="no such image"):
                view.image()
        pictures = {path.name for path in lent.data.rglob("*.png")}
        assert pictures == {f"{name}.png" for name in whole.split.train}
        assert loan.spoilt() == []
    assert not lent.data.exists()


def test_a_full_disk_while_lending_is_told_and_leaves_nothing(run, monkeypatch):
    def full(source, target):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("hydroviews.dataset.lending.shutil.copyfile", full)
    with pytest.raises(InputError, match="no space left on the disk"), run.lent():
        pass
    assert not list(run.folder.glob(".partial*"))


@pytest.mark.usefixtures("trained_here")
def test_what_a_killed_run_was_lent_goes_with_the_next(request_of, run):
    left = run.folder / ".partial-host-0123456789ab-data"
    (left / "yard").mkdir(parents=True)
    (run.folder / "record.json").unlink()
    assert evaluate(request_of())[-1].status == "done"
    assert not left.exists()


def test_depth_and_masks_are_lent_of_training_views_alone(tmp_path):
    capture = tmp_path / "capture" / "yard"
    scene = capture_in(capture)
    write_colmap(scene, capture / "sparse" / "0")
    for view in scene.views:
        write_ignored(capture / "masks" / mask_name(view.path.name), np.eye(36, 48, dtype=bool))
        write_depth(depth_path(view), np.full((36, 48), 4, np.float32))  # as far as its points
    folder = build(read_scene(capture), tmp_path / "data", patterns=[Pattern("streak", 0)])
    names = scene.split.train
    for pattern, images in (("clean", "clean"), ("streak-0", "streak-0/images")):
        with lend(folder, pattern, names, scene.split.test, tmp_path / "near") as loan:
            found = {path.relative_to(loan.data / "yard").as_posix() for path in loan.data.glob("yard/**/*.*")}
            opened = open_clean(loan.data / "yard") if pattern == "clean" else open_variant(loan.data / "yard", pattern)
            assert opened.train_views[0].ignored().sum() == 36
        expected = {f"{images}/{name}.png" for name in names} | {f"masks/{name}.png.png" for name in names}
        expected |= {f"depth/{name}.exr" for name in names if pattern == "clean"} | {"split.json"}
        model = {f"sparse/0/{path.name}" for path in (folder / "sparse/0").iterdir()}
        assert found == expected | model


@pytest.mark.parametrize("name", ["clean/view-00.png", "clean/view-03.png", "streak-0/images/view-01.png"])
def test_a_picture_that_changed_is_not_trained_on_and_not_scored(request_of, run, name):
    paint(run.data / "yard" / name)
    with pytest.raises(InputError, match=rf"{name}: changed or missing[\s\S]*--repair"):
        evaluate(request_of("MeanColour"))
    if name == "clean/view-00.png":
        with pytest.raises(InputError, match=r"view-00\.png: changed since it was built"):
            score(run)
    elif name.startswith("streak"):
        with pytest.raises(InputError, match=r"view-01\.png: changed since it was built"), run.lent():
            pass


def test_the_record_names_the_data_that_were_used(run, evaluated):
    assert evaluated.data_sha256 == data_hash(run.data, "yard", "streak-0")
    write_json(run.data / "yard" / "streak-0" / "pattern.json", {"drawing_code": "another"})
    with pytest.raises(InputError, match=r"pattern\.json: changed since it was built"):
        score(run)
