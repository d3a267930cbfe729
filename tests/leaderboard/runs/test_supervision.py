"""However a process ends, the one that started it knows why; none outlives it, and none takes more than it may."""

import io
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest
import tethered_toy
from processes import wait_until

from hydroviews.cli.process_family import Family
from hydroviews.errors import InputError
from leaderboard.runs import supervision
from leaderboard.runs.supervision import HOUR, WORKERS, Limits, Watch, known_workers, newest_change, run_tethered

PLACES = os.pathsep.join([str(Path(tethered_toy.__file__).parent), str(Path(__file__).parents[3])])
LONG = Limits(time=1, stall=1)
LINUX = pytest.mark.skipif(sys.platform != "linux", reason="elsewhere processes and their memory are not told so well")


@pytest.fixture
def why(tmp_path, monkeypatch):
    """Says why a deed was not done."""
    monkeypatch.setenv("PYTHONPATH", PLACES)

    def run(deed: str, limits: Limits = LONG) -> str:
        watch = Watch(limits, [tmp_path])
        return run_tethered("tethered_toy", [f"--deed={deed}"], tmp_path, watch, supervision.end_gently, limits.memory)

    return run


@pytest.mark.parametrize(
    ("deed", "reason"),
    [
        ("works", ""),
        ("exits with 0", "its process ended before the work was done, with exit status 0"),
        ("exits with 130", "its process ended before the work was done, with exit status 130"),
        ("calls sys.exit", "SystemExit: 0"),
        ("interrupts itself", "KeyboardInterrupt"),
        ("is killed", "ended by SIGKILL (out of memory?)"),
        ("raises", "ArithmeticError: step 7"),
        ("is asked to end", "ended by SIGTERM"),
        ("reads its arguments", ""),
        ("reads its input", "EOFError: EOF when reading a line"),
    ],
)
def test_why_it_has_not_done_its_work_is_known_whatever_its_exit_status(why, deed, reason):
    assert why(deed) == reason


def test_bad_input_ends_its_parent_too(why):
    with pytest.raises(InputError, match="no such camera"):
        why("refuses")


def test_a_thread_that_is_left_running_holds_nobody_up(why, monkeypatch, tmp_path, caplog):
    monkeypatch.setattr(supervision, "LINGER", 0.1)
    assert why("leaves a thread") == ""
    assert not (tmp_path / "late").exists()
    assert "a thread left running?" in caplog.text


@pytest.mark.parametrize(
    ("deed", "reason"),
    [
        ("leaves a process", ""),
        ("leaves a process and raises", "ArithmeticError: step 7"),
        pytest.param("leaves a process in a session of its own", "", marks=LINUX),
    ],
)
def test_processes_that_are_left_running_are_ended(why, tmp_path, caplog, deed, reason):
    caplog.set_level("INFO", "hydroviews")
    before = sleepers(tmp_path)
    assert why(deed) == reason
    assert sleepers(tmp_path) == before == []
    if sys.platform == "linux":
        assert "left running by what has ended, and ended now: 1" in caplog.text


def sleepers(folder: Path) -> list[str]:
    """The processes that have to do with a folder."""
    listed = subprocess.run(["ps", "-ww", "-eo", "args"], capture_output=True, text=True, check=True).stdout
    return [line for line in listed.splitlines() if str(folder) in line]


@LINUX
def test_the_system_refuses_more_memory_than_allowed(why):
    assert why("eats memory", Limits(1, 1, memory=0.5)) == "MemoryError:  (--memory-limit 0.5)"
    assert why("eats memory", Limits(1, 1, memory=4)) == ""


def test_who_takes_too_long_or_is_silent_is_ended(why, monkeypatch):
    monkeypatch.setattr(supervision, "GRACE", 0.1)
    short = 1 / HOUR
    assert "no line printed and no file written for" in why("hangs", Limits(time=1, stall=short))
    assert "--time-limit" in why("hangs", Limits(time=short, stall=1))


@pytest.fixture
def hours(monkeypatch):
    """Sets the clock, in hours."""
    now = [0.0]
    monkeypatch.setattr(supervision.time, "monotonic", lambda: now[0] * HOUR)
    return lambda hour: now.__setitem__(0, hour)


@pytest.mark.parametrize("sign", ["line", "file"])
def test_who_prints_or_writes_is_not_taken_for_dead(tmp_path, hours, sign):
    notes, folder, printed = tmp_path / "notes", tmp_path / "run", io.StringIO()
    notes.mkdir()
    folder.mkdir()
    watch = Watch(Limits(time=10, stall=1), [notes, folder])
    stream = supervision.Heartbeat(printed, notes / "alive")
    for hour in (0.9, 1.8, 2.7):
        hours(hour)
        if sign == "line":
            print("step", hour, file=stream)
        else:
            (folder / f"checkpoint-{hour}").touch()
        assert not watch.overdue()
    assert printed.getvalue().count("step") == (3 if sign == "line" else 0)
    hours(3.8)
    assert watch.overdue()
    assert watch.reason.startswith("no line")


@LINUX
def test_what_a_command_of_the_method_writes_is_a_sign_of_life_wherever_it_goes(tmp_path, hours):
    family, watch = Family(), Watch(Limits(time=10, stall=1), [tmp_path])
    pulse = supervision.Pulse(family, tmp_path / "alive")
    shell, pipes = "while read line; do echo $line; done", {"stdin": subprocess.PIPE, "stdout": subprocess.DEVNULL}
    script = subprocess.Popen(["sh", "-c", shell], env=family.environment(), bufsize=0, **pipes)
    try:
        wait_until(lambda: script.pid in family.written(), script)
        pulse.feel()
        for hour in (0.9, 1.8, 2.7):
            before = family.written()
            script.stdin.write(b"step\n")
            wait_until(lambda before=before: family.written() != before, script)
            hours(hour)
            pulse.feel()
            assert not watch.overdue()
        hours(3.8)
        pulse.feel()
        assert watch.overdue()
    finally:
        script.kill()
        script.communicate()


def test_what_is_removed_while_it_is_looked_for_does_not_count(tmp_path, monkeypatch):
    gone, kept = tmp_path / "a" / "gone", tmp_path / "b" / "deep"
    for folder in (gone, kept):
        folder.mkdir(parents=True)
    (kept / "file").touch()
    scandir = os.scandir

    def removing(path):
        if str(path) == str(gone):
            gone.rmdir()
        return scandir(path)

    monkeypatch.setattr(os, "scandir", removing)
    assert newest_change(tmp_path) >= (kept / "file").stat().st_mtime_ns
    assert not gone.exists()


@pytest.mark.parametrize(
    ("name", "value", "told"),
    [
        ("time", 0.0, "too little"),
        ("stall", -1.0, "too little"),
        ("memory", float("nan"), "too little"),
        ("time", float("inf"), "leave it out for the default"),
        ("memory", float("inf"), "leave it out for no limit"),
    ],
)
def test_a_limit_is_finite_and_above_nothing(name, value, told):
    with pytest.raises(InputError, match=rf"--{name}-limit [\s\S]*{told}"):
        Limits(**{"time": 1.0, "stall": 1.0, name: value})


@pytest.mark.parametrize(("deed", "options"), [("holds the lock", []), ("hangs", ["--portable"])])
def test_a_child_does_not_outlive_a_parent_that_is_killed(tmp_path, deed, options):
    child = ["-m", "tethered_toy", *options, f"--deed={deed}", f"--tether.notes={tmp_path}"]
    code = (
        "import os, subprocess, sys;"
        "p = subprocess.Popen([sys.executable, *sys.argv[1:], f'--tether.parent={os.getpid()}']);"
        f"open({str(tmp_path / 'pid')!r}, 'w').write(str(p.pid)); p.wait()"
    )
    environment = {**os.environ, "PYTHONPATH": PLACES}
    parent = subprocess.Popen([sys.executable, "-c", code, *child], env=environment)
    wait_until(lambda: (tmp_path / "pid").exists() and (tmp_path / "pid").read_text(), parent)
    time.sleep(1)  # in its deed or still importing: it must end both ways
    parent.kill()
    parent.wait()
    number = int((tmp_path / "pid").read_text())
    deadline = time.monotonic() + 60
    while _runs(number) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not _runs(number)


def _runs(number: int) -> bool:
    """Whether a process runs; one that nobody has waited for does not."""
    try:
        return Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_how_many_runs_go_at_a_time(monkeypatch):
    monkeypatch.delenv(WORKERS, raising=False)
    assert known_workers() == 1
    for given, workers in (("", None), ("4", 4)):
        monkeypatch.setenv(WORKERS, given)
        assert known_workers() == workers, given
    for given in ("0", "-1", "two", "1.5"):
        monkeypatch.setenv(WORKERS, given)
        with pytest.raises(InputError, match=f"{WORKERS}={given}"):
            known_workers()
