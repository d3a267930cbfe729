import json
import os
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from unittest import mock

import pandas as pd
import pytest
from processes import PATIENCE, wait_until

from hydroviews.errors import InputError
from leaderboard.evaluate import carry_out
from leaderboard.runs.supervision import Limits
from leaderboard.sweep import local, matrix
from leaderboard.sweep.matrix import build_runs, matrix_of, read_matrix
from leaderboard.sweep.sweep import SweepRequest, sweep

REPOSITORY = Path(__file__).parents[3]
WAITS_ONCE = "swept/demo/toy_methods.WaitsOnce/yard/streak-0/seed-0"
TIMES = ["train_s", "before_s", "after_s", "render_fps", "peak_mem_mb", "sessions"]  # of a run that was started again


@pytest.fixture
def request_of(toys, evaluated_once, tmp_path, monkeypatch):
    """Makes a request for toy methods on the capture, with data and results in `tmp_path`."""
    monkeypatch.setattr(matrix, "probe", lambda method, profile: None)
    usual = {"scenes": (str(evaluated_once[0] / "yard"),), "patterns": ("streak-0",), "workers": 1}
    usual |= {"data": evaluated_once[0] / "data", "results": tmp_path / "swept"}
    return lambda *methods, **changes: SweepRequest(
        methods=tuple(f"toy_methods:{m}" for m in methods), **usual | changes
    )


@pytest.fixture
def scored_here(monkeypatch):
    """Lets a sweep carry out its runs in this process: one of their own loads PyTorch for the scores, which is slow."""

    def run_in_this(run, limits, environment, stop):
        with mock.patch.dict(os.environ, environment):
            carry_out(run, limits)
        return ""

    monkeypatch.setattr(local, "_run", run_in_this)


@pytest.mark.usefixtures("scored_here", "trained_here")
def test_a_failed_run_costs_its_row_only_and_what_is_done_is_skipped(request_of, tmp_path, caplog):
    request = request_of("Raises", "MeanColour")
    [(failed, reason)] = sweep(request).items()
    assert failed.method == "toy_methods:Raises"
    assert "diverged at step 7" in reason
    table = pd.read_csv(tmp_path / "swept/leaderboard.csv").set_index("method")
    assert dict(table.status) == {"toy_methods:MeanColour": "done", "toy_methods:Raises": "failed"}
    assert table.workers["toy_methods:MeanColour"] == 1
    record = tmp_path / "swept/demo/toy_methods.MeanColour/yard/streak-0/seed-0/record.json"
    before = record.stat().st_mtime_ns
    sweep(request)
    assert "2 runs, 1 of them done" in caplog.text
    assert record.stat().st_mtime_ns == before


def test_runs_of_a_matrix(request_of, tmp_path, evaluated_once):
    """A method that sees clean views runs on them once a seed; nothing runs twice."""
    methods = ("toy_methods:MeanColourClean", "toy_methods:MeanColour", "toy_methods:MeanColour")
    wanted = {"methods": methods, "scenes": [str(evaluated_once[0] / "yard")], "patterns": ["streak-0"]}
    runs = build_runs(matrix_of(wanted | {"seeds": [0, 3]}, "-"), evaluated_once[0] / "data", tmp_path)
    expected = [(name, seed) for seed in (0, 3) for name in ("MeanColourClean clean", "MeanColour streak-0")]
    found = [(f"{run.method.removeprefix('toy_methods:')} {run.pattern}", run.seed) for run in runs]
    assert found == expected


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("methods = []\nscenes = ['a']", "methods"),
        ("scenes = ['a']", "no methods"),
        ("methods = ['3dgs']\nseeds = [-1]", "seeds"),
        ("methods = ['3dgs']\nsceens = ['a']", "unknown sceens"),
        ("methods = ", "cannot be read"),
    ],
)
def test_files_that_are_no_matrix(tmp_path, text, told):
    (tmp_path / "matrix.toml").write_text(text)
    with pytest.raises(InputError, match=told):
        read_matrix(tmp_path / "matrix.toml")


def test_options_that_contradict_each_other(tmp_path):
    (tmp_path / "matrix.toml").write_text("methods = ['3dgs']")
    with pytest.raises(InputError, match="--methods"):
        sweep(SweepRequest(matrix=tmp_path / "matrix.toml", methods=("3dgs",)))
    with pytest.raises(InputError, match="--slurm and --ray"):
        sweep(SweepRequest(methods=("3dgs",), slurm=tmp_path / "a", ray="auto"))
    with pytest.raises(InputError, match="more than there are cores"):
        local.run_here([None], Limits(1, 1), workers=10_000, threads=1)


def test_workers_fit_into_cores_and_memory(monkeypatch):
    monkeypatch.setattr(local, "cores", lambda: list(range(16)))
    monkeypatch.setattr(local, "available_memory", lambda: 20.0)
    given = ((1, None), (1, 1.0), (8, 1.0), (32, 100.0))
    assert [local.fitting_workers(*one) for one in given] == [5, 16, 2, 1]


@pytest.mark.skipif(len(local.cores()) < 2, reason="needs two cores")
def test_runs_side_by_side_have_cores_and_threads_of_their_own(monkeypatch):
    """And the thread that waits for them, as the rest of this process, is not kept to any."""
    code = "import os, json; print(json.dumps([sorted(os.sched_getaffinity(0)), os.environ['NUMBA_NUM_THREADS']]))"

    def look(run, limits, environment, stop):
        time.sleep(0.2)  # so that both workers take part
        child = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, check=True)
        return child.stdout.decode()

    monkeypatch.setattr(local, "_run", look)
    before = local.cores()
    seen = [json.loads(text) for text in local.run_here(range(4), Limits(1, 1), workers=2, threads=1).values()]
    assert sorted({core for (core,), _ in seen}) == before[:2]
    assert {threads for _, threads in seen} == {"1"}
    assert local.cores() == before


def environment() -> dict[str, str]:
    """In which processes find the packages and the toy methods."""
    return {**os.environ, "PYTHONPATH": os.pathsep.join([str(REPOSITORY), str(Path(__file__).parents[1])])}


def begun(request: SweepRequest, run: Path) -> subprocess.Popen:
    """The command of a sweep, whose method is at its training."""
    options = ["--methods", *request.methods, "--scenes", *request.scenes, "--patterns", *request.patterns]
    options += ["--data", str(request.data), "--results", str(request.results), "--workers", "1"]
    line = [sys.executable, "-m", "leaderboard", "sweep", *options]
    process = subprocess.Popen(line, env=environment(), stderr=subprocess.PIPE, text=True, start_new_session=True)
    wait_until((run / "begun").exists, process)
    return process


def row(results: Path, method: str) -> pd.Series:
    table = pd.read_csv(results / "leaderboard.csv").set_index("method").drop(columns=TIMES)
    return table.loc[f"toy_methods:{method}"]


@pytest.mark.parametrize(
    ("kill", "number", "status"),
    [
        (os.kill, signal.SIGKILL, -signal.SIGKILL),  # the run goes on for a moment: the next sweep must not meet it
        (os.killpg, signal.SIGTERM, 143),  # SIGINT goes the same way: see test_kills_and_disks.py
    ],
    ids=["killed", "interrupted"],
)
@pytest.mark.usefixtures("scored_here", "trained_here")  # the command that is ended is as it is
def test_ended_in_training_the_row_is_that_of_an_evaluation(request_of, tmp_path, evaluated_once, kill, number, status):
    request = request_of("WaitsOnce")
    process = begun(request, tmp_path / WAITS_ONCE)
    kill(process.pid, number)
    _, errors = process.communicate(timeout=PATIENCE)
    assert process.returncode == status
    assert "Traceback" not in errors
    if kill is os.killpg:
        with pytest.raises(ProcessLookupError):
            os.killpg(process.pid, 0)
    assert sweep(request) == {}
    expected = row(evaluated_once[0] / "results", "MeanColour")
    pd.testing.assert_series_equal(row(tmp_path / "swept", "WaitsOnce"), expected, check_names=False)


def test_a_slurm_script_whose_tasks_are_the_runs(request_of, tmp_path):
    """Also where names have what Slurm and shells take for something else."""
    script, results = tmp_path / "array.sh", tmp_path / "20 % #1"
    limits = {"time_limit": 1.5, "memory_limit": 2.0, "threads": 2}
    request = request_of("MeanColour", slurm=script, results=results, seeds=(0, 1), **limits)
    assert sweep(request) == {}
    text = script.read_text()
    for line in ("--array=0-1", "--cpus-per-task=2", "--mem=3000M", "--time=120"):  # above the run's own limits
        assert f"#SBATCH {line}\n" in text
    output = next(line for line in text.splitlines() if "--output" in line).removeprefix("#SBATCH ")
    assert shlex.split(output, comments=True) == [f"--output={tmp_path}/20 %% #1/logs/slurm-%A-%a.log"]
    task = {**environment(), "SLURM_ARRAY_TASK_ID": "1"}
    subprocess.run(["bash", str(script)], env=task, check=True, capture_output=True)
    assert [path.parent.name for path in results.rglob("record.json")] == ["seed-1"]
    sweep(request)  # the next script has what is missing
    assert "#SBATCH --array=0-0\n" in script.read_text()


def test_ray_is_not_installed_or_nothing_answers(request_of, monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(InputError, match="Ray is not installed"):
        sweep(request_of("MeanColour", ray="127.0.0.1:6379"))
    monkeypatch.setitem(sys.modules, "ray", object())
    for address in ("127.0.0.1:1", "nowhere", "127.0.0.1:notaport"):
        with pytest.raises(InputError, match="no Ray cluster answers"):
            sweep(request_of("MeanColour", ray=address))


class OneAfterTheOther:
    """Stands for Ray where it is not installed: tasks are done when they are asked for, last first."""

    exceptions = SimpleNamespace(RayError=ConnectionResetError)

    def __init__(self, lost: str) -> None:
        self.lost, self.connected, self.options = lost, False, {}

    def init(self, address, log_to_driver, runtime_env):
        self.connected = True

    def remote(self, **options):
        self.options = options
        return lambda function: SimpleNamespace(remote=lambda run, limits: (function, run, limits))

    def wait(self, waiting, num_returns):
        return [waiting[-1]], waiting[:-1]

    def get(self, task):
        function, run, limits = task
        if run.method == self.lost:
            raise ConnectionResetError("node died\nat work")
        return function(run, limits)

    def shutdown(self):
        self.connected = False


@pytest.mark.usefixtures("trained_here")
def test_a_task_that_ray_loses_costs_its_row_only(request_of, tmp_path, monkeypatch):
    ray = OneAfterTheOther(lost="toy_methods:Raises")
    monkeypatch.setitem(sys.modules, "ray", ray)
    failures = sweep(request_of("MeanColour", "Raises", ray="auto", threads=2, memory_limit=2.0))
    assert {run.method: reason for run, reason in failures.items()} == {ray.lost: "lost by Ray: node died"}
    assert list(pd.read_csv(tmp_path / "swept/leaderboard.csv").status) == ["done"]
    assert (ray.options["num_cpus"], ray.options["memory"]) == (2, 2_000_000_000)
    assert not ray.connected
