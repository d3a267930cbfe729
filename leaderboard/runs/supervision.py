"""Processes that run a method: what they may take, and how whoever started them learns how they ended.

An exit status says nothing, as a method can end its process with any. So parent and child share a folder of notes:
the child writes its outcome there at its end. A child that has done so has ended, whatever its threads still do.
"""

import faulthandler
import logging
import math
import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Protocol, TextIO

from hydroviews.cli.process_family import Family, shows_writing
from hydroviews.cli.processes import Ended, end_with_parent, run_child
from hydroviews.errors import InputError, printable
from hydroviews.files.atomic import read_json, write_json

logger = logging.getLogger(__name__)

HOUR, GB = 3600, 10**9
GRACE, PATIENCE = 3.0, 30.0  # seconds until a process that has to end gets SIGTERM, and until it is killed
LOOK, BEAT = 5.0, 2.0  # seconds between two looks for signs of life, at most, and between two at what was written
LINGER = 10.0  # seconds that a child may take to end once it has written its outcome
ALIVE, OUTCOME = "alive", "outcome.json"  # notes
WORKERS = "HYDROVIEWS_WORKERS"  # environment of a run: how many run at a time on its machine; empty if not known
DONE, INPUT, METHOD = "done", "input", "method"  # how a process ended: well, by bad input, by the method


@dataclass(frozen=True)
class Limits:
    """What a process may take.

    Raises:
        InputError: a limit that is not above 0, or infinite.
    """

    time: float  # hours in all
    stall: float  # hours without a line printed or a file written
    memory: float | None = None  # 10^9 bytes; None for what there is

    def __post_init__(self) -> None:
        for name in ("time", "stall", "memory"):
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise InputError(f"--{name}-limit {value:g}: too little", expected="more than 0")
            if value == math.inf:
                otherwise = "no limit" if name == "memory" else "the default"
                raise InputError(f"--{name}-limit inf: not finite", fix=f"leave it out for {otherwise}")


@dataclass(frozen=True)
class Tether:
    """What ties a child to its parent; the parent gives it on the child's command line."""

    notes: Path
    parent: int  # its process
    memory: float | None = None  # 10^9 bytes


class Overdue(Protocol):
    """Says when a process has to end."""

    reason: str  # why; "" as long as it may go on

    def overdue(self) -> bool:
        """Whether it has to, asked several times a second."""


def known_workers() -> int | None:
    """How many runs go at a time on this machine: 1 unless a sweep says otherwise, None where it does not know.

    Raises:
        InputError: the environment variable is no number.
    """
    given = os.environ.get(WORKERS, "1")
    if given and not (given.isdecimal() and int(given)):
        raise InputError(f"{WORKERS}={given}: no number of runs", expected="1 or more, or nothing")
    return int(given) if given else None


def run_tethered(
    module: str,
    arguments: Sequence[str],
    notes: Path,
    watch: Overdue,
    end: Callable[[subprocess.Popen], None],
    memory: float | None = None,
    output: IO[bytes] | None = None,
    environment: Mapping[str, str] | None = None,
) -> str:
    """Run a module's `main`, which is `tethered`, as a process of its own.

    Args:
        module: such as leaderboard.runs.train_and_render.
        arguments: of its command, without the tether.
        notes: a new folder, for what they tell each other.
        watch: says when it has to end.
        end: asks it to.
        memory: 10^9 bytes that it may have; what there is if not given.
        output: takes what it prints; the terminal if not given.
        environment: of the process; this one's if not given.

    Returns:
        Why it has not done its work, "" if it has.

    Raises:
        InputError: it met something the user can mend.
        KeyboardInterrupt, SystemExit: this process got Ctrl-C or SIGTERM; the child has ended.
    """
    tether = [f"--tether.notes={notes}", f"--tether.parent={os.getpid()}"]
    tether += [f"--tether.memory={memory}"] if memory else []
    command = [sys.executable, "-m", module, *tether, *arguments]
    family, written = Family(), notes / OUTCOME
    pulse, linger = Pulse(family, notes / ALIVE), Linger(written)

    def overdue() -> bool:
        pulse.feel()
        return linger.overdue() or watch.overdue()

    status = run_child(command, lambda process: linger.end(process, end), environment, overdue, output, family)
    outcome = read_json(written) if written.is_file() else {"kind": METHOD, "reason": in_words(status)}
    if outcome["kind"] == DONE:
        return ""
    if watch.reason:
        return watch.reason
    if outcome["kind"] == INPUT:
        raise InputError(outcome["reason"])
    return str(outcome["reason"])


def end_gently(process: subprocess.Popen) -> None:
    """Wait until a run has saved and stopped: it has got the signal that this process has got, or gets SIGTERM."""
    for patience, stop in ((GRACE, process.terminate), (PATIENCE, process.kill)):
        try:
            process.wait(patience)
        except subprocess.TimeoutExpired:
            stop()


@contextmanager
def tethered(tether: Tether) -> Iterator[None]:
    """Around the work of a child: it ends with its parent, keeps within its memory, and writes how it ended.

    Its printed lines are written before its outcome, since its parent may end the child from then on.
    """
    end_with_parent(tether.parent)
    faulthandler.enable()  # a crash shows where it was
    if tether.memory:
        limit_memory(tether.memory)
    if not shows_writing():
        for name in ("stdout", "stderr"):
            setattr(sys, name, Heartbeat(getattr(sys, name), tether.notes / ALIVE))
    try:
        yield
    except InputError as error:
        _write_outcome(tether, INPUT, str(error))
        sys.exit(2)  # the parent tells the reason
    except KeyboardInterrupt:  # of the method's own making, unless the parent was interrupted as well: it knows
        _write_outcome(tether, METHOD, "KeyboardInterrupt")
        sys.exit(130)
    except Ended as end:  # the parent was asked to end and tells so, or somebody has ended this process alone
        _write_outcome(tether, METHOD, f"ended by {end.name}")
        sys.exit(end.code)
    except BaseException as error:
        limit = f" (--memory-limit {tether.memory:g})" if tether.memory and isinstance(error, MemoryError) else ""
        _write_outcome(tether, METHOD, f"{type(error).__name__}: {error}{limit}")
        raise
    _write_outcome(tether, DONE, "")


def limit_memory(limit: float) -> None:
    """Let the system refuse this process more memory than so many 10^9 bytes: a MemoryError, or a crash.

    On Linux, what it has to itself and may write to counts. Address space does not, of which CUDA reserves more than
    there is memory; elsewhere it is all that can be limited.
    """
    kind = resource.RLIMIT_DATA if sys.platform == "linux" else resource.RLIMIT_AS
    hard = resource.getrlimit(kind)[1]
    wanted = int(limit * GB)
    resource.setrlimit(kind, (wanted if hard == resource.RLIM_INFINITY else min(wanted, hard), hard))


def in_words(status: int) -> str:
    """How a process ended that has written no outcome."""
    if status >= 0:
        return f"its process ended before the work was done, with exit status {status}"
    return f"ended by {signal.Signals(-status).name}" + (" (out of memory?)" if status == -signal.SIGKILL else "")


class Watch:
    """Looks whether a process is over its limits."""

    def __init__(self, limits: Limits, folders: Sequence[Path]) -> None:
        """Start the clocks; a change in one of the folders is a sign of life."""
        self._limits, self._folders = limits, folders
        self._start = self._alive = self._looked = time.monotonic()
        self._newest = 0
        self.reason = ""  # set once it is

    def overdue(self) -> bool:
        """Whether it is; says why in `reason`."""
        now, limits = time.monotonic(), self._limits
        if now - self._looked > min(LOOK, limits.stall * HOUR / 4):
            self._looked, newest = now, max(map(newest_change, self._folders), default=0)
            if newest != self._newest:
                self._newest, self._alive = newest, now
        if now - self._start > limits.time * HOUR:
            self.reason = f"not done after {limits.time:g} h (--time-limit, in hours, allows more)"
        elif now - self._alive > limits.stall * HOUR:
            self.reason = f"no line printed and no file written for {limits.stall:g} h (--stall-limit allows more)"
        return bool(self.reason)


def newest_change(folder: Path) -> int:
    """When a file in a folder or below was last written, in nanoseconds of its file system's clock; 0 if there is none.

    What other processes remove meanwhile does not count.
    """
    newest = 0
    for parent, folders, files in os.walk(folder):  # which passes over a folder that is gone by now
        for name in (*folders, *files):
            with suppress(OSError):
                newest = max(newest, os.lstat(os.path.join(parent, name)).st_mtime_ns)
    return newest


class Heartbeat:
    """A text stream that touches a file when it is written to, once a second at most: where `Pulse` feels nothing."""

    def __init__(self, stream: TextIO, alive: Path) -> None:
        """Of a stream that takes the text, and the file."""
        self._stream, self._alive, self._due = stream, alive, 0.0

    def write(self, text: str) -> int:
        """As the stream does."""
        now = time.monotonic()
        if now >= self._due:
            self._due = now + 1
            with suppress(OSError):
                self._alive.touch()
        return self._stream.write(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


class Pulse:
    """Touches a file when any process of a run has written something, to whatever file, pipe or terminal.

    So lines count of a script that a method runs as a command, also where the method reads them itself. Linux counts
    what processes write; elsewhere `Heartbeat` takes notice of what is printed.
    """

    def __init__(self, family: Family, alive: Path) -> None:
        self._family, self._alive = family, alive
        self._due = 0.0
        self._before: dict[int, int] = {}

    def feel(self) -> None:
        """Look, if it is time to."""
        if time.monotonic() < self._due:
            return
        written = self._family.written()
        if written != self._before:
            with suppress(OSError):
                self._alive.touch()
        self._due, self._before = time.monotonic() + BEAT, written


class Linger:
    """How long a child is still there that has written its outcome: a thread that is no daemon keeps its process."""

    def __init__(self, outcome: Path) -> None:
        self._outcome, self._since = outcome, math.inf

    def overdue(self) -> bool:
        """Whether it has been there for too long."""
        if self._since == math.inf and self._outcome.is_file():
            self._since = time.monotonic()
        return time.monotonic() - self._since > LINGER

    def end(self, process: subprocess.Popen, gently: Callable[[subprocess.Popen], None]) -> None:
        """End the child: at once if its work is done."""
        if self.overdue():
            logger.warning(
                "the run has finished, but its process did not end (a thread left running?): the process was ended"
            )
            process.kill()
        else:
            gently(process)


def _write_outcome(tether: Tether, kind: str, reason: str) -> None:
    for stream in (sys.stdout, sys.stderr):
        with suppress(Exception):  # whatever a method has made of it
            stream.flush()
    write_json(tether.notes / OUTCOME, {"kind": kind, "reason": printable(reason)})
