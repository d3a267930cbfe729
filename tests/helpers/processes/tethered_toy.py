"""A process that ends in many ways: python -m tethered_toy --deed=... --tether.notes=..."""

import argparse
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

from hydroviews.cli.commands import run_command
from hydroviews.errors import InputError
from leaderboard.runs.supervision import Tether, tethered


def fails(error: BaseException) -> None:
    raise error


def later(seconds: float) -> list[str]:
    """A command that makes a file `late` beside the notes, if it lives that long."""
    return [sys.executable, "-c", f"import time; time.sleep({seconds}); open({str(LATE)!r}, 'w')"]


LATE = Path("late")  # set to a path by `main`
DEEDS = {
    "works": lambda: None,
    "exits with 0": lambda: os._exit(0),
    "exits with 130": lambda: os._exit(130),
    "calls sys.exit": lambda: sys.exit(0),
    "interrupts itself": lambda: fails(KeyboardInterrupt()),
    "is killed": lambda: os.kill(os.getpid(), signal.SIGKILL),
    "is asked to end": lambda: (os.kill(os.getpid(), signal.SIGTERM), time.sleep(60)),
    "raises": lambda: fails(ArithmeticError("step 7")),
    "refuses": lambda: fails(InputError("no such camera")),
    "eats memory": lambda: bytearray(10**9),
    "hangs": lambda: time.sleep(600),
    "leaves a thread": lambda: threading.Thread(target=lambda: (time.sleep(30), LATE.touch())).start(),
    "leaves a process": lambda: subprocess.Popen(later(600)),
    "leaves a process in a session of its own": lambda: subprocess.Popen(later(600), start_new_session=True),
    "leaves a process and raises": lambda: (subprocess.Popen(later(600)), fails(ArithmeticError("step 7"))),
    "reads its arguments": lambda: argparse.ArgumentParser().parse_args(),
    "reads its input": input,
    "holds the lock": lambda: sum(range(10**12)),  # Python's, so that no other thread runs
}


def main(deed: str, tether: Tether) -> None:
    global LATE
    LATE = tether.notes / "late"
    with tethered(tether):
        DEEDS[deed]()


if __name__ == "__main__":
    if "--portable" in sys.argv:
        sys.argv.remove("--portable")
        sys.platform = "another"  # without prctl
    run_command(main, prog="toy")
