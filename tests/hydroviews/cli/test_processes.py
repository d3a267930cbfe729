"""Commands end as they are asked to, and what they start ends with them."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from processes import PATIENCE, wait_until

from hydroviews.cli import commands
from hydroviews.cli.commands import run_command
from hydroviews.cli.plugins import load_plugin
from hydroviews.cli.process_family import Family
from hydroviews.cli.processes import Ended, run_child
from hydroviews.cli.starting import SPINS, SPINS_IF_BUSY, others_run

REPOSITORY = Path(__file__).parents[3]
COMMAND = """
import sys, time
from pathlib import Path
from hydroviews.cli.commands import run_command
def main(begun: Path) -> None:
    begun.write_text(" ".join(sys.argv[1:]))
    time.sleep(600)
run_command(main, prog="waiting")
"""


ENVIRONMENT = {**os.environ, "PYTHONPATH": str(REPOSITORY)}


def ran(*command, **options):
    options = {"env": ENVIRONMENT, "capture_output": True, "text": True, "check": False, **options}
    return subprocess.run([sys.executable, *command], **options)


def as_in_a_terminal():
    """A shell's background jobs ignore these signals, and so does what they start."""
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)


def waiting(folder, code):
    """A process of a command that has begun."""
    command = [sys.executable, "-c", code, "--begun", str(folder / "begun")]
    options = {"env": ENVIRONMENT, "stderr": subprocess.PIPE, "text": True, "preexec_fn": as_in_a_terminal}
    process = subprocess.Popen(command, **options)
    wait_until((folder / "begun").exists, process)
    return process


@pytest.mark.parametrize(("number", "status"), [(signal.SIGTERM, 143), (signal.SIGHUP, 129)])
def test_who_is_asked_to_end_says_in_one_line_how_to_go_on(tmp_path, number, status):
    process = waiting(tmp_path, COMMAND)
    process.send_signal(number)
    _, errors = process.communicate(timeout=PATIENCE)
    assert errors == f"\nended by {number.name}; the same command goes on from here\n"
    assert process.returncode == status


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_second_signal_while_it_ends_changes_nothing(tmp_path, number, status):
    process = waiting(tmp_path, "import atexit, time; atexit.register(time.sleep, 3)" + COMMAND)
    process.send_signal(number)
    assert process.stderr.readline() == "\n"
    assert process.stderr.readline().endswith("the same command goes on from here\n")
    process.send_signal(number)
    _, errors = process.communicate(timeout=PATIENCE)
    assert (process.returncode, errors) == (status, "")


PROGRAMS = ("hydroviews", "leaderboard", "deraings.enhancement", "baselines.derain_nerf.raindrop_attention")
BENCHMARKS = ("benchmarks.busy_machine", "benchmarks")


@pytest.mark.parametrize("package", [*PROGRAMS, *BENCHMARKS])
def test_who_is_asked_to_end_while_it_imports_says_so_as_well(tmp_path, package):
    (tmp_path / "tyro.py").write_text("import signal\nsignal.raise_signal(signal.SIGTERM)\n")  # what all import first
    path = os.pathsep.join([str(tmp_path), str(REPOSITORY)])
    process = ran("-m", package, "--help", env={**os.environ, "PYTHONPATH": path}, cwd=tmp_path)
    assert process.stderr == "\nended by SIGTERM; the same command goes on from here\n"
    assert process.returncode == 143


def test_opencv_keeps_its_words_on_damaged_pictures_to_itself(tmp_path):
    picture = np.random.default_rng(0).integers(0, 256, (64, 64, 3)).astype(np.uint8)
    (tmp_path / "cut.tif").write_bytes(cv2.imencode(".tif", picture)[1].tobytes()[:9000])
    code = "from hydroviews.cli.starting import begin; begin(); import cv2; assert cv2.imread('cut.tif', -1) is None"
    process = ran("-c", code, cwd=tmp_path)
    assert (process.returncode, process.stderr) == (0, "")


@pytest.mark.parametrize(("given", "spins"), [({}, {SPINS, SPINS_IF_BUSY}), ({"GOMP_SPINCOUNT": "7"}, {"7"})])
def test_threads_that_wait_soon_sleep_unless_the_user_has_them_wait_otherwise(given, spins):
    code = "from hydroviews.cli.starting import begin; begin(); import os; print(os.environ['GOMP_SPINCOUNT'])"
    inherited = {name: value for name, value in ENVIRONMENT.items() if name != "GOMP_SPINCOUNT"}
    assert ran("-c", code, env=inherited | given).stdout.strip() in spins


@pytest.mark.parametrize(("running", "cores", "busy"), [(1, 2, False), (2, 2, True), (2, 16, False), (9, 16, True)])
def test_a_machine_is_busy_where_others_run_on_half_of_its_cores_now(tmp_path, running, cores, busy):
    load = tmp_path / "loadavg"
    load.write_text(f"9.99 9.99 9.99 {running}/240 77")
    assert others_run(cores, load) == busy
    load.write_text("")
    assert not others_run(cores, load)
    assert not others_run(cores, tmp_path / "missing")


def test_what_a_plugin_reads_of_the_command_line_is_empty(monkeypatch):
    monkeypatch.setattr(commands, "end_when_asked", lambda: None)  # the handlers of this process stay
    monkeypatch.setattr(sys, "argv", ["program", "--size", "3"])
    found = []

    def main(size: int) -> None:
        found.append((size, sys.argv[1:]))

    run_command(main, prog="program")
    assert found == [(3, [])]


def test_a_signal_that_comes_while_a_plugin_is_imported_is_not_its_fault(tmp_path, monkeypatch):
    (tmp_path / "slow_module.py").write_text("import signal\nsignal.raise_signal(signal.SIGTERM)\n")
    monkeypatch.syspath_prepend(tmp_path)

    def ended(number, _):
        raise Ended(number)

    before = signal.signal(signal.SIGTERM, ended)
    try:
        with pytest.raises(Ended) as end:
            load_plugin("METHOD=slow_module:Any", "slow_module:Any", "hydroviews.methods", "method", "Class")
    finally:
        signal.signal(signal.SIGTERM, before)
    assert end.value.code == 143


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere the environment of processes is not shown")
def test_a_family_is_what_was_started_with_its_mark_and_nobody_else():
    family = Family()
    code = "import subprocess, sys; p = subprocess.Popen(['sleep', '600'], start_new_session=True); p.wait()"
    first = subprocess.Popen([sys.executable, "-c", code], env=family.environment())
    other = subprocess.Popen(["sleep", "600"], env=Family().environment())
    try:
        wait_until(lambda: len(family.members()) == 2, first)
        first.kill()
        first.wait()
        assert len(family.members()) == 1  # whose parent is gone, in a session of its own
        assert family.end(first.pid) == 1
        assert family.members() == []
        assert other.poll() is None
    finally:
        for process in (first, other):
            process.kill()
            process.wait()


def test_a_family_in_a_family_is_ended_with_it(monkeypatch):
    outer = Family()
    for name, value in outer.environment({}).items():
        monkeypatch.setenv(name, value)
    inner = Family()
    assert inner.mark.startswith(f"{outer.mark}/")
    assert not Family().mark.startswith(inner.mark)


def test_a_worker_that_is_ended_prints_no_stack_trace():
    process = ran("-c", "import signal, hydroviews.scene.lenses; signal.raise_signal(signal.SIGTERM)")
    assert (process.returncode, process.stdout, process.stderr) == (-signal.SIGTERM, "", "")


def test_a_child_has_nothing_to_read_and_its_status_is_given_back():
    code = "import sys; sys.exit(7 if sys.stdin.read() == '' else 0)"
    assert run_child([sys.executable, "-c", code], subprocess.Popen.kill) == 7
