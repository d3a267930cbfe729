"""How every command line of the project ends: plain errors, a kind word on interruption."""

import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager

import tyro

from hydroviews.errors import InputError
from hydroviews.files.malloc import keep_freed_memory


def run_command(commands: Mapping[str, Callable[..., None]], prog: str) -> None:
    """Run the named subcommand; exit 2 on bad input, 130 on Ctrl-C, 143 when asked to end."""
    signal.signal(signal.SIGTERM, lambda number, _: sys.exit(128 + number))
    keep_freed_memory()
    try:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])  # see `deferred_interrupts`
        tyro.extras.subcommand_cli_from_dict(dict(commands), prog=prog)
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        print("\ninterrupted; the same command goes on from here", file=sys.stderr)
        sys.exit(130)


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


def run_process(command: Sequence[str], environment: Mapping[str, str]) -> None:
    """Run a command that knows nothing of Ctrl-C, and end it when this one is interrupted.

    Raises:
        subprocess.CalledProcessError: it failed.
    """
    with deferred_interrupts():
        process = subprocess.Popen(command, env=environment)
    try:
        status = process.wait()
    finally:
        process.kill()
        process.wait()
    if status:
        raise subprocess.CalledProcessError(status, command)
