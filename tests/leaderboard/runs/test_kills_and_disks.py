"""Killed commands go on and end in the bytes of an undisturbed run.

`KILLS=10` kills real builds, trainings, scorings and sweeps ten times each at random moments, which takes minutes.
Without `KILLS`, a toy shows that the test detects a command that resumes wrongly.
"""

import os
from pathlib import Path

import pytest
from kills import Stage, files_below, fresh, kills, stages, undisturbed

from hydroviews.formats.writers import MODEL, write_colmap
from leaderboard.contract.toy_scene import draw_room

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
