"""What every command line of the project shares: what is shown, how commands end, how they start processes."""

import argparse
import logging
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from typing import Any

import tyro
from tqdm import tqdm

from hydroviews.errors import InputError
from hydroviews.files.malloc import keep_freed_memory

PACKAGES = ("hydroviews", "baselines", "deraings", "leaderboard", "benchmarks")  # whose messages are shown
LOG_LEVEL = "HYDROVIEWS_LOG_LEVEL"  # DEBUG, INFO or WARNING; processes that a command starts inherit it
PLAIN, DETAILED = "%(message)s", "%(asctime)s %(levelname)s %(name)s: %(message)s"
HELP = "With any command, anywhere: --verbose shows times, modules and details, --quiet warnings only."
ENDING = (signal.SIGINT, signal.SIGTERM)


def run_command(commands: Mapping[str, Callable[..., Any]] | Callable[..., Any], prog: str) -> None:
    """Run the named subcommand, or the one command there is, with messages shown as asked for.

    Exits 2 on bad input, 130 on Ctrl-C, 143 when asked to end.
    """
    signal.signal(signal.SIGTERM, lambda number, _: sys.exit(128 + number))
    keep_freed_memory()
    try:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])  # see `deferred_interrupts`
        arguments = choose_log_level(sys.argv[1:])
        show_logs()
        if callable(commands):
            tyro.cli(commands, prog=prog, args=arguments)
        else:
            tyro.extras.subcommand_cli_from_dict(dict(commands), prog=prog, description=HELP, args=arguments)
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        print("\ninterrupted; the same command goes on from here", file=sys.stderr)
        sys.exit(130)


def choose_log_level(arguments: Sequence[str]) -> list[str]:
    """Take `--verbose` and `--quiet` out of a command's arguments and set $HYDROVIEWS_LOG_LEVEL by them."""
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    choice = parser.add_mutually_exclusive_group()
    choice.add_argument("--verbose", dest="level", action="store_const", const="DEBUG")
    choice.add_argument("--quiet", dest="level", action="store_const", const="WARNING")
    found, rest = parser.parse_known_args(arguments)
    if found.level:
        os.environ[LOG_LEVEL] = found.level
    return rest


def show_logs() -> None:
    """Show the project's messages: warnings on standard error, others on standard output; nobody else's.

    Raises:
        InputError: $HYDROVIEWS_LOG_LEVEL is no level.
    """
    level = os.environ.get(LOG_LEVEL, "INFO")
    if level not in ("DEBUG", "INFO", "WARNING"):
        raise InputError(f"{LOG_LEVEL}={level}: no such level", expected="DEBUG, INFO or WARNING")
    handler = _Console()
    handler.setFormatter(logging.Formatter(DETAILED if level == "DEBUG" else PLAIN))
    for package in PACKAGES:
        logger = logging.getLogger(package)
        logger.setLevel(level)
        logger.handlers[:] = [handler]


class _Console(logging.Handler):
    """Writes whole lines above tqdm's bars, to the standard streams as they are at that moment."""

    def emit(self, record: logging.LogRecord) -> None:
        try:
            stream = sys.stderr if record.levelno >= logging.WARNING else sys.stdout
            tqdm.write(self.format(record), file=stream)
            stream.flush()
        except Exception:
            self.handleError(record)


@contextmanager
def deferred_interrupts() -> Iterator[None]:
    """Holds Ctrl-C back until the block ends, and for a process started in it until its `run_command`.

    A terminal sends Ctrl-C to all processes of a command; one that is still importing would answer with a traceback.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def held_signals() -> Iterator[list[int]]:
    """Collects Ctrl-C and SIGTERM in a list while the block lasts; then the first of them does what it would have done.

    Signals are Python's main thread's business: in another thread nothing is held, and the list stays empty.
    """
    received: list[int] = []
    before: dict[int, Any] = {}
    if threading.current_thread() is threading.main_thread():
        before = {number: signal.getsignal(number) for number in ENDING}
    try:
        for number, handler in before.items():
            if handler != signal.SIG_IGN:
                signal.signal(number, lambda number, _: received.append(number))
        yield received
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        if received:
            signal.raise_signal(received[0])


def run_child(
    command: Sequence[str], end: Callable[[subprocess.Popen], None], environment: Mapping[str, str] | None = None
) -> int:
    """Run a command as a process that never outlives this one: on Ctrl-C or SIGTERM it is ended first.

    Args:
        command: the program and its arguments.
        end: asks the process to stop; whatever it leaves running is killed. Signals wait until it returns.
        environment: of the process; this one's if not given.

    Returns:
        Its exit status; negative where a signal ended it.
    """
    with held_signals() as received:
        with deferred_interrupts():
            process = subprocess.Popen(command, env=environment)
        try:
            while process.poll() is None and not received:
                with suppress(subprocess.TimeoutExpired):
                    process.wait(0.2)
            if received:
                end(process)
        finally:
            process.kill()
            process.wait()
    return process.returncode


def run_process(command: Sequence[str], environment: Mapping[str, str] | None = None) -> None:
    """Run a command that knows nothing of Ctrl-C, and kill it when this one is interrupted.

    Raises:
        subprocess.CalledProcessError: it failed.
    """
    status = run_child(command, subprocess.Popen.kill, environment)
    if status:
        raise subprocess.CalledProcessError(status, command)
