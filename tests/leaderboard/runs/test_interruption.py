import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from processes import PATIENCE, wait_until

from leaderboard.evaluate import evaluate

REPOSITORY = Path(__file__).parents[3]


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
