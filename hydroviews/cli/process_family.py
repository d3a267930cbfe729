"""A process and all that it starts, found by a mark in their environment, whatever groups and sessions they are in.

Parents and process groups do not tell: a process whose parent has ended belongs to another, and one may leave its
group. The environment is inherited by all of them. Linux shows it; elsewhere only the group of the first is found.
"""

import os
import signal
import time
import uuid
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

MARK = "HYDROVIEWS_FAMILY"  # environment of a process: the families it is of, outermost first
BETWEEN = "/"  # families
PROC = Path("/proc")
ROUNDS, PAUSE = 20, 0.05  # of waiting, and of killing, as processes may start others meanwhile; seconds between two


def _new_mark() -> str:
    """Of a family within that of this process."""
    return BETWEEN.join([*filter(None, [os.environ.get(MARK)]), uuid.uuid4().hex[:12]])


@dataclass(frozen=True)
class Family:
    """What is started with `environment`, and everything started by it."""

    mark: str = field(default_factory=_new_mark)

    def environment(self, given: Mapping[str, str] | None = None) -> dict[str, str]:
        """The environment of its first process: the one given, or that of this process, and the mark."""
        return {**(os.environ if given is None else given), MARK: self.mark}

    def members(self) -> list[int]:
        """The numbers of its processes that run, without this one; none where the system does not show them."""
        return [number for number in _processes() if number != os.getpid() and self._has(number)]

    def written(self) -> dict[int, int]:
        """How many bytes each of its processes has written, to files, pipes and terminals, in all of its life.

        Processes that the system shows no such count of are left out.
        """
        counts = {number: _bytes_written(number) for number in self.members()}
        return {number: count for number, count in counts.items() if count is not None}

    def end(self, first: int) -> int:
        """Kill what is left of it, once its first process has ended; returns how many processes were still running.

        Args:
            first: the number of its first process, which may be that of a group.
        """
        left = self._left()
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(first, signal.SIGKILL)
        for _ in range(ROUNDS):
            running = self.members()
            if not running:
                break
            for number in running:
                with suppress(ProcessLookupError, PermissionError):
                    os.kill(number, signal.SIGKILL)
            time.sleep(PAUSE)
        return len(left)

    def _left(self) -> list[int]:
        """Its processes that do not end by themselves in a moment, as helpers do whose pipe was closed."""
        for _ in range(ROUNDS):
            left = self.members()
            if not left:
                break
            time.sleep(PAUSE)
        return left

    def _has(self, number: int) -> bool:
        try:
            variables = (PROC / str(number) / "environ").read_bytes().split(b"\0")
        except OSError:  # somebody else's, or it has ended
            return False
        marks = [word for word in variables if word.startswith(f"{MARK}=".encode())]
        found = marks[-1].decode(errors="replace").partition("=")[2] if marks else ""
        return f"{found}{BETWEEN}".startswith(f"{self.mark}{BETWEEN}")


def shows_writing() -> bool:
    """Whether the system shows how much processes write."""
    return _bytes_written(os.getpid()) is not None


def _processes() -> Iterator[int]:
    """The numbers of all processes that the system shows."""
    if PROC.is_dir():
        yield from (int(name) for name in os.listdir(PROC) if name.isdecimal())


def _bytes_written(number: int) -> int | None:
    with suppress(OSError, ValueError):
        for line in (PROC / str(number) / "io").read_text().splitlines():
            if line.startswith("wchar:"):
                return int(line.split()[1])
    return None
