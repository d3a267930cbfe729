import subprocess
import sys
from dataclasses import replace

import finished_runs
import numpy as np
import torch
from finished_runs import finished_run

from baselines.method import TrainingSummary
from baselines.splatting.kernels.simd import SIMD
from hydroviews.files.atomic import read_json
from leaderboard.records import columns
from leaderboard.runs import train_and_render as predict
from leaderboard.runs.own_files import PREDICTION
from leaderboard.runs.train_and_render import train_and_render
from leaderboard.scoring.score import score


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
    record = score(run)
    assert (record.device, record.render_device, record.simd) == ("a card", "cpu", SIMD)
    assert record.peak_gpu_mem_mb == 3250 > record.peak_mem_mb
    assert profiles == ["demo", "demo"]
    assert {"peak_gpu_mem_mb", "render_device"} < set(columns())
