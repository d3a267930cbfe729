"""What is recorded comes out again from the renders, and what does not is told."""

import json
import shutil
from dataclasses import replace

import cv2
import numpy as np
import pandas as pd
import pytest
from finished_runs import finished_run

from hydroviews.errors import InputError
from hydroviews.metrics import METRICS
from hydroviews.scene.images import read_image, write_png
from leaderboard.__main__ import rescore_command
from leaderboard.runs.finished_runs import open_run
from leaderboard.scoring.rescore import rescore
from leaderboard.scoring.score import score


@pytest.fixture(scope="module")
def scored_once(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scored")
    run = finished_run(folder)
    score(run)
    return folder, run.folder.relative_to(folder)


@pytest.fixture
def run(scored_once, tmp_path):
    """The folder of a scored run, for the test to change."""
    folder, below = scored_once
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    return tmp_path / below


def repaint(run, factor, kind, channels):
    """The first render with the same colours in another format, opaque if there is alpha."""
    path = run / "renders" / "view-00.png"
    pixels = cv2.imread(str(path)).astype(kind) * kind(factor)
    if channels == 4:
        pixels = cv2.cvtColor(pixels, cv2.COLOR_BGR2BGRA)
    cv2.imwrite(str(path), pixels)


def test_every_number_comes_out_again_and_nothing_is_written(run, tmp_path, capsys):
    before = {path: path.read_bytes() for path in (tmp_path / "results").rglob("*") if path.is_file()}
    rescore_command(tmp_path / "results", tmp_path / "data")
    assert capsys.readouterr().out == "1 runs calculated again, 0 numbers differ by more than 1e-06\n"
    assert {path: path.read_bytes() for path in before} == before


def test_a_score_that_was_made_up_in_both_files_is_told(run, tmp_path, capsys):
    """Record and view agree with each other, and with nothing else."""
    views = pd.read_csv(run / "per_view.csv")
    views.loc[1, "psnr"] += 1
    views.to_csv(run / "per_view.csv", index=False)
    record = json.loads((run / "record.json").read_text())
    (run / "record.json").write_text(json.dumps(record | {"psnr": round(record["psnr"] + 0.5, 5)}))
    found = rescore(tmp_path / "results", tmp_path / "data")
    assert [(one.view, one.metric) for one in found.differences] == [("view-08", "psnr"), ("mean", "psnr")]
    assert found.differences[0].recorded - found.differences[0].now == pytest.approx(1)
    with pytest.raises(SystemExit) as ended:
        rescore_command(tmp_path / "results", tmp_path / "data")
    assert ended.value.code == 1
    assert "view-08   psnr" in capsys.readouterr().out


def test_a_render_that_was_painted_over_is_told(run, tmp_path, caplog):
    render = run / "renders" / "view-00.png"
    write_png(render, 0.9 * read_image(render))
    found = rescore(tmp_path / "results", tmp_path / "data")
    assert {one.view for one in found.differences} == {"view-00", "mean"}
    assert {one.metric for one in found.differences} == {"psnr", "ssim", "lpips_alex", "lpips_vgg"}
    assert "its renders are not those that were scored" in caplog.text


def test_of_a_partial_run_what_is_missing_is_told_only_where_it_can_be_had_now(run, tmp_path, monkeypatch):
    def no_weights(image, target, ignored):
        raise InputError("no weights")

    psnr, ssim, alex, vgg = METRICS
    with monkeypatch.context() as offline:
        offline.setattr(
            "leaderboard.scoring.score.find_metrics", lambda: (psnr, ssim, replace(alex, function=no_weights), vgg)
        )
        assert score(open_run(run, tmp_path / "data")).status == "partial"
        assert rescore(tmp_path / "results", tmp_path / "data").agrees
    found = rescore(tmp_path / "results", tmp_path / "data").differences
    assert [(one.view, one.metric, one.recorded) for one in found] == [
        (view, "lpips_alex", None) for view in ("view-00", "view-08", "mean")
    ]


@pytest.mark.parametrize(
    ("damage", "reason"),
    [
        (lambda run: (run / "renders" / "view-00.png").unlink(), "view-00.png: not a render"),
        (lambda run: repaint(run, 257, np.uint16, 3), "16 bits, 3 channels, 48x36 pixels"),
        (lambda run: repaint(run, 1, np.uint8, 4), "8 bits, 4 channels, 48x36 pixels"),
        (lambda run: (run / "record.json").write_text("{"), "record.json: not valid JSON"),
        (lambda run: (run / "prediction.json").unlink(), "training has not finished"),
    ],
)
def test_what_cannot_be_calculated_again_is_told_and_no_agreement(run, tmp_path, damage, reason):
    damage(run)
    found = rescore(tmp_path / "results", tmp_path / "data")
    assert not found.agrees
    assert reason in found.not_compared[run]


def test_without_runs_there_is_nothing_to_agree(tmp_path):
    with pytest.raises(InputError, match="no finished run"):
        rescore(tmp_path, tmp_path)
