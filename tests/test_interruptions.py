"""Ctrl-C at any moment ends quietly: also while a process is still importing what it needs."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from processes import PATIENCE, wait_until

REPOSITORY = Path(__file__).parents[1]
CHILD = """
import pathlib, time
pathlib.Path("importing").touch()
time.sleep(1)
from hydroviews.cli.commands import run_command
run_command({"wait": lambda: time.sleep(600), "rest": lambda: None}, prog="child")
"""
PARENT = """
import subprocess, sys
from hydroviews.cli.commands import run_command
from hydroviews.cli.processes import deferred_interrupts
child = sys.argv.pop()
def start():
    with deferred_interrupts():
        process = subprocess.Popen([sys.executable, "-c", child, "wait"])
    try:
        process.wait()
    finally:
        process.wait(600)
run_command({"start": start, "rest": lambda: None}, prog="parent")
"""


@pytest.fixture
def family(tmp_path):
    """A command whose child is importing; both in a process group of their own, as under a terminal."""
    environment = {**os.environ, "PYTHONPATH": str(REPOSITORY)}
    command = [sys.executable, "-c", PARENT, "start", CHILD]
    process = subprocess.Popen(
        command, cwd=tmp_path, env=environment, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    wait_until((tmp_path / "importing").exists, process)
    yield process
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def test_a_child_that_is_importing_ends_quietly(family):
    (child,) = Path(f"/proc/{family.pid}/task/{family.pid}/children").read_text().split()
    os.killpg(family.pid, signal.SIGINT)
    _, errors = family.communicate(timeout=PATIENCE)
    assert family.returncode == 130
    assert "Traceback" not in errors
    assert errors.count("interrupted") == 2  # by the parent at once, by the child once it can
    assert not Path(f"/proc/{child}").exists()
