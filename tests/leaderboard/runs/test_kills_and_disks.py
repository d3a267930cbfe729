"""Interrupted and killed commands go on and end in the bytes of an undisturbed run.

`KILLS=10` kills real builds, trainings, scorings and sweeps ten times each at random moments, which takes minutes.
Without `KILLS`, a toy shows that the test detects a command that resumes wrongly.
"""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from kills import Stage, files_below, fresh, kills, stages, undisturbed
from processes import PATIENCE, wait_until

from hydroviews.formats.writers import MODEL, write_colmap
from leaderboard.contract.toy_scene import draw_room
from leaderboard.evaluate import evaluate

KILLS = int(os.environ.get("KILLS", "0"))
PATTERNS = ("streak-0", "storm-0")  # drops on the lens take Blender minutes
REPOSITORY = Path(__file__).parents[3]
WORKER = """
import pathlib, sys, time
folder, right = pathlib.Path(sys.argv[1]), sys.argv[2] == "right"
for name in "abcd":
    path = folder / name
    if right and path.exists():
        continue
    again = path.exists()
    part = folder / ".part"
    part.write_bytes((name + again * "again").encode() * 10_000)
    part.rename(path)
    time.sleep(0.1)
"""


@pytest.fixture
def stage(tmp_path, monkeypatch):
    """Makes a stage of a worker that goes on rightly, or writes twice what is there."""
    (tmp_path / "kill_worker.py").write_text(WORKER)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    return lambda how: Stage("work", "whole", lambda folder: ["kill_worker", str(folder), how], files_below)


@pytest.mark.parametrize("how", ["right", "wrong"])
def test_kills(stage, tmp_path, how):
    alone, writing = undisturbed(stage(how), tmp_path / "whole")
    assert set(alone) == set("abcd")
    assert writing > 0.3
    assert [left == alone for left in kills(stage(how), tmp_path / "trial", writing, 2)] == [how == "right"] * 2


@pytest.mark.skipif(not KILLS, reason="KILLS=10 kills real commands ten times each")
def test_real_commands_go_on_where_they_were_killed(tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", f"{REPOSITORY}{os.pathsep}{REPOSITORY / 'tests/helpers/processes'}")
    write_colmap(draw_room(fresh(tmp_path / "room") / "images"), tmp_path / "room" / MODEL)
    for stage in stages(tmp_path, PATTERNS):
        alone, writing = undisturbed(stage, tmp_path / stage.result)
        for left in kills(stage, tmp_path / "trial", writing, KILLS):
            assert left == alone, stage.name


@pytest.mark.parametrize(
    ("to", "number", "status"),
    [
        ("group", signal.SIGINT, 130),  # Ctrl-C in a terminal
        ("run", signal.SIGINT, 1),  # by somebody else: the run has failed, and is tried again
        ("command", signal.SIGTERM, 143),
        ("command twice", signal.SIGINT, 130),
    ],
)
@pytest.mark.usefixtures("toys", "evaluated", "trained_here")  # reference rows are there; the last call is ours
def test_an_interruption_ends_quietly_and_the_same_command_goes_on(request_of, caplog, to, number, status):
    request = request_of("WaitsOnce")
    code = (
        "import leaderboard.evaluate as e, leaderboard.tables.dataframes as t;"
        "e.CEILING = t.CEILING = 'toy_methods:MeanColourClean'; e.FLOOR = t.FLOOR = 'toy_methods:MeanColour';"
        "e.probe = lambda *_: None; from hydroviews.__main__ import main; main()"
    )
    command = [sys.executable, "-c", code, "eval", "toy_methods:WaitsOnce", "--scene", request.scene]
    command += ["--patterns", "streak-0", "--data", str(request.data), "--results", str(request.results)]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(REPOSITORY), str(Path(__file__).parents[1])])}
    process = subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True, start_new_session=True)
    run = request.results / "demo/toy_methods.WaitsOnce/yard/streak-0/seed-0"
    wait_until((run / "begun").exists, process)
    (child,) = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    if to == "group":
        os.killpg(process.pid, number)
    else:
        os.kill(int(child) if to == "run" else process.pid, number)
    if to == "command twice":
        time.sleep(1)  # it waits for the run now
        os.kill(process.pid, number)
    _, errors = process.communicate(timeout=PATIENCE)
    assert process.returncode == status
    assert ("interrupted; the same command goes on" in errors) == (status == 130)
    assert not Path(f"/proc/{child}").exists()
    assert "Traceback" not in errors
    assert (run / "record.json").exists() == (status == 1)
    assert [record.status for record in evaluate(request)] == ["done"] * 3
    assert "toy_methods:MeanColour on yard/streak-0, seed 0: kept" in caplog.text
