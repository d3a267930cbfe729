"""Processes that a command starts: neither they nor what they start outlives it, whatever signals come."""

import ctypes
import logging
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from typing import IO, Any

from hydroviews.cli.process_family import Family

logger = logging.getLogger(__name__)

ASKED = (signal.SIGTERM, signal.SIGHUP)  # a process is asked to end, the second when its terminal is closed
ENDING = (signal.SIGINT, *ASKED)
# What a library with a handler for crashes takes: SIGTERM too, so that a worker which is ended looks like a crash.
CRASHES = (signal.SIGABRT, signal.SIGBUS, signal.SIGFPE, signal.SIGILL, signal.SIGSEGV, signal.SIGTERM)
ACTION = 1024  # bytes, more than any system's `struct sigaction`
PR_SET_PDEATHSIG = 1  # of Linux' prctl
LOOK = 1.0  # seconds between two looks whether a parent is still there


class Ended(SystemExit):
    """This process was asked to end by a signal: no code that it runs has ended it, and none may go on."""

    def __init__(self, number: int) -> None:
        """The exit status is the shell's for that signal."""
        super().__init__(128 + number)
        self.name = signal.Signals(number).name


def end_when_asked() -> None:
    """From now on SIGTERM and a closed terminal raise `Ended`, unless they are ignored."""
    for number in ASKED:
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, _raise_ended)


def _raise_ended(number: int, _: object) -> None:
    raise Ended(number)


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
    """Collects the signals of ENDING in a list while the block lasts; then the first does what it would have done.

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
    command: Sequence[str],
    end: Callable[[subprocess.Popen], None],
    environment: Mapping[str, str] | None = None,
    overdue: Callable[[], bool] = lambda: False,
    output: IO[bytes] | None = None,
    family: Family | None = None,
) -> int:
    """Run a command as a process that never outlives this one, and leaves nothing running.

    It has a session of its own, and nothing to read. On Ctrl-C, SIGTERM or SIGHUP it is ended first: its group gets
    Ctrl-C, as from a terminal, or it gets SIGTERM.

    Args:
        command: the program and its arguments.
        end: asks the process to stop; whatever it leaves running is killed. Signals wait until it returns.
        environment: of the process; this one's if not given.
        overdue: asked several times a second; where it says yes the process is ended.
        output: takes what the process writes; the terminal if not given.
        family: of the process, for who wants to watch it.

    Returns:
        Its exit status; negative where a signal ended it.
    """
    family = family or Family()
    with held_signals() as received:
        with deferred_interrupts():
            process = subprocess.Popen(
                command,
                env=family.environment(environment),
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
                start_new_session=True,
            )
        try:
            while process.poll() is None and not received and not overdue():
                with suppress(subprocess.TimeoutExpired):
                    process.wait(0.2)
            if process.poll() is None:
                _pass_on(received, process)
                end(process)
        finally:
            process.kill()
            process.wait()
            left = family.end(process.pid)
    if left and not received:
        logger.info("processes left running by what has ended, and ended now: %d", left)
    return process.returncode


def _pass_on(received: Sequence[int], process: subprocess.Popen) -> None:
    """Pass on to a process what this one got first, if it got anything."""
    with suppress(ProcessLookupError):
        if received and received[0] == signal.SIGINT:
            os.killpg(process.pid, signal.SIGINT)
        elif received:
            process.terminate()


def end_with_parent(parent: int) -> None:
    """Let this process be killed as soon as its parent is gone, even if that was killed and could not end it.

    Linux does it at once, also while Python's lock is held; elsewhere a thread finds out within a second.

    Args:
        parent: the parent's number, as it may be gone already.
    """
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    threading.Thread(target=_follow, args=(parent,), daemon=True).start()


def _follow(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(LOOK)
    os.kill(os.getpid(), signal.SIGKILL)


def run_process(command: Sequence[str], environment: Mapping[str, str] | None = None) -> None:
    """Run a command that knows nothing of Ctrl-C, and kill it when this one is interrupted.

    Raises:
        subprocess.CalledProcessError: it failed.
    """
    status = run_child(command, subprocess.Popen.kill, environment)
    if status:
        raise subprocess.CalledProcessError(status, command)


@contextmanager
def kept_handlers() -> Iterator[None]:
    """Leaves the handlers of CRASHES as they were before the block, in any thread.

    Python's `signal` knows only handlers that were installed through it, and works in the main thread alone.
    """
    sigaction = ctypes.CDLL(None).sigaction
    before = {number: ctypes.create_string_buffer(ACTION) for number in CRASHES}
    for number, action in before.items():
        sigaction(int(number), None, action)
    try:
        yield
    finally:
        for number, action in before.items():
            sigaction(int(number), action, None)
