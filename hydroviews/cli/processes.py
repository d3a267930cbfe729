"""Processes that a command starts: none outlives it, whatever signals come."""

import signal
import subprocess
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from typing import Any

ENDING = (signal.SIGINT, signal.SIGTERM)


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
