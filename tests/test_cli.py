"""What every command line shares: which messages are shown and where, and that no process outlives its command."""

import errno
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from processes import PATIENCE, wait_until

from hydroviews.cli import commands

REPOSITORY = Path(__file__).parents[1]
PROGRAM = """
import logging, sys
from tqdm import tqdm
from hydroviews.cli.commands import run_command
from hydroviews.cli.processes import run_process
def work(depth: int = 0, bar: bool = False) -> None:
    if depth:
        run_process([sys.executable, __file__, "work", f"--depth={depth - 1}"])
    logger = logging.getLogger("baselines.splatting")
    for _ in tqdm(range(1), disable=not bar):
        logger.debug("detail")
        logger.info("news %d", depth)
        logger.warning("trouble")
    logging.getLogger("somebody.else").warning("theirs")
    logging.getLogger("somebody.else").info("never")
run_command({"work": work, "rest": print}, prog="x")
"""
STUBBORN = """
import pathlib, sys, time
from hydroviews.cli.commands import run_command
from hydroviews.cli.processes import run_child
def end(process):
    pathlib.Path("ending").touch()
    time.sleep(2)
child = "import os, pathlib, time; pathlib.Path('pid').write_text(str(os.getpid())); time.sleep(600)"
run_command({"start": lambda: run_child([sys.executable, "-c", child], end), "rest": print}, prog="x")
"""


@pytest.fixture
def run(tmp_path):
    """Runs the program with arguments, as a command of its own."""
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)

    def run_it(*arguments: str, **environment: str) -> subprocess.CompletedProcess:
        return subprocess.run(
            [sys.executable, str(program), *arguments],
            env={**os.environ, "PYTHONPATH": str(REPOSITORY), **environment},
            capture_output=True,
            text=True,
        )

    return run_it


@pytest.mark.parametrize(
    ("arguments", "news"), [(("work",), "news 0\n"), (("work", "--quiet"), ""), (("--quiet", "work"), "")]
)
def test_news_goes_to_standard_output_unless_quiet_and_trouble_to_standard_error(run, arguments, news):
    done = run(*arguments)
    assert (done.returncode, done.stdout, done.stderr) == (0, news, "trouble\ntheirs\n")


def test_a_file_that_may_not_be_opened_is_told_without_a_traceback(monkeypatch, capsys):
    def refused() -> None:
        raise PermissionError(errno.EACCES, "Permission denied", "theirs.jpg")

    monkeypatch.setattr(sys, "argv", ["x"])
    for module, name in ((signal, "signal"), (commands, "show_logs"), (commands, "keep_freed_memory")):
        monkeypatch.setattr(module, name, lambda *_: None)
    with pytest.raises(SystemExit) as ended:
        commands.run_command(refused, prog="x")
    assert ended.value.code == 2
    assert capsys.readouterr().err.startswith("error: theirs.jpg: no permission\n  what to do: ")


def test_bars_are_not_torn(run):
    done = run("work", "--bar")
    assert done.stdout == "news 0\n"
    lines = done.stderr.replace("\r", "\n").splitlines()
    assert "trouble" in lines
    assert any("100%" in line for line in lines)


@pytest.mark.parametrize("arguments", [("work", "--verbose"), ("--verbose", "work")])
def test_verbose_adds_times_modules_and_details(run, arguments):
    done = run(*arguments)
    detail, news = done.stdout.splitlines()
    assert re.fullmatch(r"20[\d-]+ [\d:,.]+ DEBUG baselines\.splatting: detail", detail)
    assert news.endswith("INFO baselines.splatting: news 0")
    assert "WARNING baselines.splatting: trouble" in done.stderr


@pytest.mark.parametrize(("flags", "news"), [((), ["news 0", "news 1"]), (("--quiet",), [])])
def test_a_process_that_a_command_starts_shows_as_much(run, flags, news):
    done = run("work", "--depth=1", *flags)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == news
    assert done.stderr.count("trouble") == 2


def test_the_two_exclude_each_other_and_a_wrong_level_is_refused(run):
    assert run("work", "--quiet", "--verbose").returncode == 2
    done = run("work", HYDROVIEWS_LOG_LEVEL="loud")
    assert done.returncode == 2
    assert done.stderr.startswith("error: HYDROVIEWS_LOG_LEVEL=loud: no such level")


@pytest.mark.parametrize("second", [signal.SIGINT, signal.SIGTERM])
def test_a_second_interruption_does_not_leave_the_child_alone(tmp_path, second):
    command = subprocess.Popen(
        [sys.executable, "-c", STUBBORN, "start"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(REPOSITORY)},
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    wait_until(lambda: (tmp_path / "pid").exists() and (tmp_path / "pid").read_text(), command)
    command.send_signal(signal.SIGINT)
    wait_until((tmp_path / "ending").exists, command)
    command.send_signal(second)
    _, errors = command.communicate(timeout=PATIENCE)
    assert command.returncode == 130
    assert "Traceback" not in errors
    assert not Path("/proc", (tmp_path / "pid").read_text()).exists()


def test_a_reader_that_has_seen_enough_is_no_error():
    code = "from hydroviews.cli.commands import run_command;"
    code += "run_command({'talk': lambda: print('line\\n' * 100_000), 'rest': print}, prog='x')"
    command = [sys.executable, "-c", code, "talk"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=REPOSITORY) as process:
        assert process.stdout.readline() == b"line\n"
        process.stdout.close()
        assert process.stderr.read() == b""
        assert process.wait() == 141


@pytest.mark.parametrize("package", ["hydroviews", "leaderboard"])
def test_an_interruption_during_the_imports_has_no_traceback(package):
    """It comes when the first module of others is imported; Python would tell of it in the lines of that."""
    code = f"""
import builtins, os, runpy, signal
def importing(name, *given, imported=builtins.__import__, **named):
    if name == "tyro":
        os.kill(os.getpid(), signal.SIGINT)
    return imported(name, *given, **named)
import {package}
builtins.__import__ = importing
runpy.run_module("{package}", run_name="__main__")
"""
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (ended.returncode, ended.stderr) == (-signal.SIGINT, "")
