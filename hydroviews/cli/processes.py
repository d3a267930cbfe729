"""Processes that a command starts: none outlives it, whatever signals come."""

import ctypes
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from typing import IO, Any

ENDING = (signal.SIGINT, signal.SIGTERM)
PR_SET_PDEATHSIG = 1  # of Linux' prctl
LOOK = 1.0  # seconds between two looks whether a parent is still there


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
    command: Sequence[str],
    end: Callable[[subprocess.Popen], None],
    environment: Mapping[str, str] | None = None,
    overdue: Callable[[], bool] = lambda: False,
    output: IO[bytes] | None = None,
) -> int:
    """Run a command as a process that never outlives this one: on Ctrl-C or SIGTERM it is ended first.

    Args:
        command: the program and its arguments.
        end: asks the process to stop; whatever it leaves running is killed. Signals wait until it returns.
        environment: of the process; this one's if not given.
        overdue: asked several times a second; where it says yes the process is ended as by a signal.
        output: takes what the process writes; the terminal if not given.

    Returns:
        Its exit status; negative where a signal ended it.
    """
    with held_signals() as received:
        with deferred_interrupts():
            process = subprocess.Popen(command, env=environment, stdout=output, stderr=output)
        try:
            while process.poll() is None and not received and not overdue():
                with suppress(subprocess.TimeoutExpired):
                    process.wait(0.2)
            if process.poll() is None:
                end(process)
        finally:
            process.kill()
            process.wait()
    return process.returncode


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
