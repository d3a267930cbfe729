"""Records: their schema and that of before, when they are partial, what they know of sessions, renders and memory."""

import json
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import finished_runs
import numpy as np
import pandas as pd
import pytest
import torch
from finished_runs import finished_run

from baselines.method import TrainingSummary
from baselines.splatting.kernels.simd import SIMD
from baselines.training import loop
from hydroviews import metrics
from hydroviews.errors import InputError
from hydroviews.files.atomic import read_json
from hydroviews.scene.images import read_image, write_png
from leaderboard import gather
from leaderboard.evaluate import evaluate
from leaderboard.gather import write_leaderboard
from leaderboard.records import SCHEMA, columns, read_record, write_record
from leaderboard.runs import sessions
from leaderboard.runs import train_and_render as predict
from leaderboard.runs.own_files import PREDICTION
from leaderboard.runs.train_and_render import train_and_render
from leaderboard.scoring import score

RUN = "demo/toy_methods.MeanColour/yard/streak-0/seed-0"
NEW = ("schema", "before_s", "after_s", "sessions", "renders_sha256", "submitted_by", "link")


@pytest.mark.usefixtures("toys")
def test_a_record_of_before_is_read_and_a_metric_that_it_lacks_makes_it_partial(evaluated, tmp_path):
    path = tmp_path / "results" / RUN / "record.json"
    row = json.loads(path.read_text())
    assert row["schema"] == SCHEMA
    path.write_text(json.dumps({name: value for name, value in row.items() if name not in NEW}))
    told = {"before_s": None, "after_s": None, "sessions": None, "renders_sha256": ""}
    assert read_record(path) == replace(evaluated, **told)
    path.write_text(json.dumps(row | {"ssim": None}))
    assert read_record(path).status == "partial"


@pytest.mark.usefixtures("toys", "trained_here")
def test_a_metric_that_could_not_be_had_is_completed_by_the_next_evaluation(evaluated, request_of, tmp_path):
    def offline(image, target, ignored):
        raise InputError("no weights", fix="go online")

    (tmp_path / "results" / RUN / "record.json").unlink()
    with pytest.MonkeyPatch.context() as network:
        broken = (*metrics.METRICS[:3], replace(metrics.METRICS[3], function=offline))
        network.setattr(score, "find_metrics", lambda: broken)
        partial = evaluate(request_of())[-1]
    assert (partial.status, partial.reason) == ("partial", "lpips_vgg: no weights")
    table = pd.read_csv(tmp_path / "results" / "leaderboard.csv")
    assert list(table.status) == ["done", "partial"]
    assert table.psnr[1] == evaluated.scores["psnr"]
    assert pd.isna(table.lpips_vgg[1])
    assert evaluate(request_of())[-1] == evaluated


def test_what_was_scored_has_a_digest_that_tells_renders_apart(tmp_path):
    run = finished_run(tmp_path)
    record = score.score(run)
    assert (record.status, len(record.renders_sha256)) == ("done", 64)
    assert score.score(run) == record
    render = run.folder / "renders" / "view-00.png"
    image = read_image(render)
    image[0, 0] = np.round(1 - image[0, 0])
    write_png(render, image)
    assert score.score(run).renders_sha256 != record.renders_sha256


def test_every_start_of_a_training_is_noted_with_its_code_and_its_data(tmp_path, monkeypatch):
    run = finished_run(tmp_path)
    first = score.score(run)
    assert (first.sessions, first.before_s, first.after_s) == (1, None, None)  # without a training loop
    monkeypatch.setattr(sessions, "code_version", lambda: "0.9+other")
    train_and_render(run)
    again = score.score(run)
    assert (again.sessions, again.version) == (2, f"{first.version}, then 0.9+other")
    assert {session.data_sha256 for session in sessions.read_sessions(run.folder)} == {again.data_sha256}


class TwoSteps:
    """A training of two steps, the second of which is interrupted."""

    iterations, iteration, seconds, finished = 2, 0, 0.0, False

    def step(self):
        if self.iteration == 1:
            raise KeyboardInterrupt
        self.iteration = 1
        return {"loss": 0.0}

    def state_dict(self):
        return {}


def test_seconds_before_and_after_training_are_those_outside_its_loops(tmp_path, monkeypatch):
    monkeypatch.setattr(sessions, "code_version", lambda: "1")
    (tmp_path / "config.json").write_text('{"data_sha256": "d"}')
    with pytest.raises(KeyboardInterrupt), sessions.training_session(tmp_path):
        time.sleep(0.3)
        try:
            loop.run(TwoSteps(), tmp_path / "checkpoint", {}, checkpoint_seconds=1000)
        finally:
            time.sleep(0.6)
    sessions._write(tmp_path, [*sessions.read_sessions(tmp_path), sessions.Session("2", "d", 1000.0, 2000.0)])
    noted = sessions.noted(sessions.read_sessions(tmp_path))
    assert (noted["version"], noted["sessions"]) == ("1, then 2", 2)
    assert 1000.3 <= noted["before_s"] < 1100
    assert 2000.6 <= noted["after_s"] < 2100


@pytest.mark.parametrize("content", ["[", "{}", '[{"version": 1}]', '[{"version": "1", "data_sha256": "d", "x": 1}]'])
def test_damaged_sessions_are_not_counted(tmp_path, caplog, content):
    (tmp_path / "sessions.json").write_text(content)
    assert sessions.read_sessions(tmp_path) == []
    assert "earlier sessions are not counted" in caplog.text


@pytest.mark.usefixtures("toys")
def test_of_two_evaluations_that_end_together_no_row_is_lost(evaluated, tmp_path, monkeypatch):
    results, collect = tmp_path / "results", gather.collect
    late = results / RUN.replace("streak-0", "streak-1")

    def slowly(folder):
        table = collect(folder)
        if not late.exists():  # the other evaluation ends now, between collecting and writing
            late.mkdir(parents=True)
            write_record(late, replace(evaluated, pattern="streak-1", status="failed", reason="x", scores={}))
            others.append(pool.submit(write_leaderboard, results))
        return table

    monkeypatch.setattr(gather, "collect", slowly)
    others = []
    with ThreadPoolExecutor(1) as pool:
        write_leaderboard(results)
        others[0].result()
    assert list(pd.read_csv(results / "leaderboard.csv").pattern) == ["clean", "streak-0", "streak-1"]


def peak(before: str) -> float:
    """The peak memory of a process that does something before."""
    code = f"{before}; from leaderboard.runs.train_and_render import peak_memory_mb; print(peak_memory_mb())"
    return float(subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout)


def test_memory_is_the_processs_own():
    ballast = np.ones(300_000_000, np.uint8)  # of a parent that is larger than its child
    found = peak("pass")
    assert ballast[0] == 1
    assert 450 < peak("import numpy; ballast = numpy.ones(500_000_000, numpy.uint8)") - found < 550


def test_a_record_tells_the_gpus_memory_and_where_was_rendered(tmp_path, monkeypatch):
    run = finished_run(tmp_path)
    on_the_cpu = read_json(run.folder / PREDICTION)
    assert on_the_cpu["peak_gpu_mem_mb"] is None
    assert on_the_cpu["device"] == on_the_cpu["render_device"] == "cpu"
    assert on_the_cpu["simd"] == SIMD

    monkeypatch.setattr(torch.cuda, "max_memory_allocated", lambda: 3_250_000_000)
    told, profiles = TrainingSummary(0.1, None, None, device="a card"), []
    monkeypatch.setattr(predict, "warn_of_slow_profile", profiles.append)
    for summary, rendered in ((told, "a card"), (replace(told, render_device="cpu"), "cpu")):
        monkeypatch.setattr(finished_runs.Cloud, "summary", lambda _, summary=summary: summary)
        train_and_render(run)
        prediction = read_json(run.folder / PREDICTION)
        assert (prediction["device"], prediction["render_device"]) == ("a card", rendered)
    record = score.score(run)
    assert (record.device, record.render_device, record.simd) == ("a card", "cpu", SIMD)
    assert record.peak_gpu_mem_mb == 3250 > record.peak_mem_mb
    assert profiles == ["demo", "demo"]
    assert {"peak_gpu_mem_mb", "render_device"} < set(columns())
