"""Runs published onto a board: records and scores alone, whole or not at all, and none that does not belong there."""

import json
import os
import shutil
from datetime import date
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from damage import edit as edit_json
from damage import files
from made_up_board import write_board
from PIL import Image
from synthetic import capture_in

from hydroviews.dataset.build import build
from hydroviews.dataset.manifest import data_hash
from hydroviews.dataset.variants import open_clean
from hydroviews.errors import InputError
from hydroviews.files.ownership import FOLDER
from hydroviews.rain.patterns import Pattern
from hydroviews.scene.images import read_image, write_png
from leaderboard.__main__ import publish_command
from leaderboard.gather import PUBLICATION, collect, collect_views, publication, run_folders
from leaderboard.publishing.publish import publish
from leaderboard.records import code_version

RUN = "demo/3dgs/pond/streak-1/seed-0"
SCORED = ("record.json", "per_view.csv", "learning_curve.csv")
SMALL_RENDERS = {f"renders/{view:03}.webp" for view in (0, 16, 32)}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    results = tmp_path_factory.mktemp("made")
    methods, patterns = ("3dgs", "3dgs-clean", "ours"), ("raindrop-1", "streak-1")
    write_board(results, methods, ("pond", "courtyard"), patterns, size=(16, 16))
    return results


@pytest.fixture
def results(made, tmp_path):
    return Path(shutil.copytree(made, tmp_path / "results"))


@pytest.fixture
def board(tmp_path):
    return tmp_path / "board"


def edit(results: Path, run: str = RUN, **changes) -> None:
    edit_json(results / run / "record.json", **changes)


def done(run: str, files_there: dict[str, bytes]) -> set[str]:
    return {name.removeprefix(f"{run}/") for name in files_there if name.startswith(run)}


def test_a_board_is_records_and_scores_and_reads_as_the_results_do(results, board):
    outcome = publish(results, board)
    assert (len(outcome.written), outcome.kept, outcome.left_out) == (10, 0, {})
    measured = {name: content for name, content in files(board).items() if not name.endswith(".webp")}
    assert measured == {name: content for name, content in files(results).items() if name.endswith(SCORED)}
    table = collect(board)
    pd.testing.assert_frame_equal(table, collect(results))
    pd.testing.assert_frame_equal(collect_views(table, board), collect_views(table, results))


def test_a_board_notes_when_and_with_which_version_runs_came_onto_it(results, board, tmp_path):
    publish(results, board, day=date(2026, 1, 2))
    note = {"date": "2026-01-02", "version": code_version()}
    assert publication(board) == note
    publish(results, board, day=date(2026, 1, 3))  # nothing is new
    publish(board, tmp_path / "shown")
    assert publication(board) == publication(tmp_path / "shown") == note
    for day in (4, 5):
        edit(results, train_s=day)
        publish(results, board, overwrite=True, day=date(2026, 1, day))
        assert publication(board)["date"] == f"2026-01-0{day}"
        (board / FOLDER).unlink()  # as in a copy of the repository
    assert not list(board.glob(f"{PUBLICATION}.kept*"))
    (board / PUBLICATION).write_text('{"day": 1}')
    with pytest.raises(InputError, match=f"{PUBLICATION}: not a note"):
        publication(board)


def test_what_is_partial_or_not_trusted_is_left_out_with_the_reason(results, board, capsys):
    edit(results, psnr=None)
    edit(results, "demo/ours/pond/streak-1/seed-0", psnr=99.0)
    shutil.rmtree(results / "demo/ours/courtyard/streak-1/seed-0")
    publish_command(results, board)
    printed = capsys.readouterr().out
    assert f"{RUN}: left out: partial" in printed
    assert "its scores are not those of its views" in printed
    assert f"{board}: 7 runs written, 0 there already, 2 left out" in printed
    assert set(collect(board).status) == {"done"}


def test_a_failed_run_is_published_as_its_record_alone_and_counts_in_tables(results, board):
    name = "demo/ours/pond/raindrop-1/seed-0"
    scored = {path: (results / name / path).read_bytes() for path in SCORED}
    for path in SCORED[1:]:
        (results / name / path).unlink()
    edit(results, name, status="failed", reason="no memory", psnr=None, ssim=None, lpips_alex=None, lpips_vgg=None)
    assert Path(name) in publish(results, board).written
    assert done(name, files(board)) == {"record.json"}  # and no pictures
    assert list(collect(board).query("status == 'failed'").reason) == ["no memory"]
    for path, content in scored.items():
        (results / name / path).write_bytes(content)
    assert publish(results, board, overwrite=True).written == (Path(name),)
    assert done(name, files(board)) == set(scored) | SMALL_RENDERS


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"version": "1.0.0+1234567-dirty, 1.0.0+7654321"}, "of a changed checkout, version 1.0.0+1234567-dirty"),
        ({"schema": 1}, "record of schema 1, expected 2"),
        ({"submitted_by": "Ada"}, "submitted by Ada; --submitted takes it"),
    ],
)
def test_what_does_not_belong_on_a_board_is_named_and_nothing_is_written(results, board, changes, reason):
    edit(results, **changes)
    edit(results, "demo/ours/pond/streak-1/seed-0", **changes)
    with pytest.raises(InputError) as error:
        publish(results, board)
    assert str(error.value).count(reason) == 2
    assert f"{RUN}: {reason}" in str(error.value)
    assert not board.exists()
    if "submitted_by" in changes:
        assert Path(RUN) in publish(results, board, submitted=True).written


def test_runs_on_other_data_are_refused_unless_all_of_a_variant_are_replaced(results, board):
    publish(results, board)
    edit(results, data_sha256="of a newer build")
    with pytest.raises(InputError, match=r"demo/pond/streak-1: runs on other data: (pond streak-|of a newer b)"):
        publish(results, board, overwrite=True)
    for folder in ("demo/3dgs", "demo/3dgs-clean"):
        shutil.rmtree(results / folder)
    edit(results, "demo/ours/pond/streak-1/seed-0", data_sha256="of a newer build")
    with pytest.raises(InputError, match="runs on other data"):  # the one of 3dgs on the board is of the older
        publish(results, board, overwrite=True)
    shutil.rmtree(board / "demo/3dgs")
    publish(results, board, overwrite=True)
    assert set(collect(board).query("pattern == 'streak-1' and scene == 'pond'").data_sha256) == {"of a newer build"}


def test_what_is_there_is_kept_and_another_run_in_its_place_needs_to_be_asked_for(results, board):
    publish(results, board)
    before = {path: path.stat().st_mtime_ns for path in board.rglob("*.*")}
    outcome = publish(results, board)
    assert (outcome.written, outcome.kept) == ((), 10)
    assert {path: path.stat().st_mtime_ns for path in board.rglob("*.*")} == before
    (results / RUN / "learning_curve.csv").write_text("step,seconds,loss\n1,1,1\n")  # its record is the same
    with pytest.raises(InputError, match=f"{RUN}: on the board, as another run; --overwrite replaces it"):
        publish(results, board)
    assert publish(results, board, overwrite=True).written == (Path(RUN),)


def test_an_interruption_leaves_no_half_run_and_the_same_command_does_the_rest(results, board, monkeypatch):
    replace, left = os.replace, [19]  # three runs of six files, and one file

    def interrupted(*paths):
        left[0] -= 1
        if left[0] < 0:
            raise KeyboardInterrupt
        replace(*paths)

    monkeypatch.setattr(os, "replace", interrupted)
    with pytest.raises(KeyboardInterrupt):
        publish(results, board)
    monkeypatch.undo()
    assert [len(files(folder)) for folder in run_folders(board)] == [6, 6, 6]
    killed = board / "demo/3dgs/pond/streak-1/.partial-host-0-seed-0"
    killed.mkdir(parents=True)
    (killed / "record.json").write_text("{")
    assert len(publish(results, board).written) == 7
    assert len(files(board)) == 60
    assert not killed.exists()


@pytest.mark.parametrize("listed", [True, False], ids=["written here", "of a repository"])
def test_files_of_the_users_in_the_folder_of_a_run_stay(results, board, listed, caplog):
    publish(results, board)
    for path in [] if listed else board.rglob(".hydroviews-*"):
        path.unlink()
    (board / RUN / "notes.txt").write_text("mine")
    edit(results, train_s=1.0)
    assert publish(results, board, overwrite=True).written == (Path(RUN),)
    assert json.loads((board / RUN / "record.json").read_text())["train_s"] == 1.0
    assert set(files(board / RUN)) == {"notes.txt", *SCORED} | SMALL_RENDERS
    assert (board / RUN / "notes.txt").read_text() == "mine"
    (board / RUN / "record.json").unlink()
    (board / RUN / "record.json").write_text("my own record")
    for path in board.rglob(".hydroviews-*"):
        path.unlink()
    publish(results, board, overwrite=True)
    assert (board / RUN / "record.json.kept").read_text() == "my own record"
    assert "record.json: not written by HydroViews, and in the way" in caplog.text


def test_three_small_renders_go_along_on_scenes_that_the_project_draws(tmp_path, board):
    write_board(tmp_path / "results", ("3dgs",), ("pond", "mipnerf360_bonsai"), ("streak-1",), size=(64, 48))
    publish(tmp_path / "results", board)
    assert set(files(board / RUN / "renders")) == {Path(name).name for name in SMALL_RENDERS}
    for view in (0, 16, 32):
        given = read_image(tmp_path / "results" / RUN / f"renders/{view:03}.png")
        small = np.asarray(Image.open(board / RUN / f"renders/{view:03}.webp"), np.float32) / 255
        assert np.abs(given - small).mean() < 0.05
    assert not list(board.glob("demo/3dgs/mipnerf360_bonsai/**/*.webp"))
    shutil.rmtree(board / RUN / "renders")  # what a board lacks comes with the next publication
    assert publish(tmp_path / "results", board, overwrite=True).written == (Path(RUN),)
    assert done(RUN, files(board)) >= SMALL_RENDERS
    shutil.rmtree(tmp_path / "results" / RUN / "renders")  # what is on the board stays
    assert publish(tmp_path / "results", board).written == ()


def test_views_that_runs_were_given_lie_once_on_a_board_and_are_copied_with_it(results, board, tmp_path, caplog):
    built = build(capture_in(tmp_path / "pond"), tmp_path / "data" / "demo", patterns=[Pattern("streak", 1)], seed=5)
    views = [view.name for view in open_clean(built).views][:3]
    for method in ("3dgs", "ours"):
        run = f"demo/{method}/pond/streak-1/seed-0"
        edit(results, run, data_sha256=data_hash(built.parent, "pond", "streak-1"))
        shutil.rmtree(results / run / "renders")
        (results / run / "renders").mkdir()
        for view in views:
            write_png(results / run / "renders" / f"{view}.png", np.zeros((8, 8, 3), np.float32))
    publish(results, board, data=tmp_path / "data")
    names = {f"{pattern}/{view}.webp" for pattern in ("clean", "streak-1") for view in views}
    assert set(files(board / "views/demo/pond")) == names
    assert "not the data that the runs under raindrop-1 were made on" in caplog.text
    view = board / "views/demo/pond/streak-1" / f"{views[0]}.webp"
    drawn = view.read_bytes()
    view.write_bytes(b"of other rain")
    edit(results, "demo/ours/pond/streak-1/seed-0", train_s=1.0)
    publish(results, board, data=tmp_path / "data", overwrite=True)
    assert view.read_bytes() == drawn
    publish(board, tmp_path / "copy")
    assert files(tmp_path / "copy" / "views") == files(board / "views")


def test_nothing_to_publish_is_told(tmp_path, board):
    with pytest.raises(InputError, match="no run that is done or failed"):
        publish(tmp_path, board)
