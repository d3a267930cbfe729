"""A process that ends in many ways: python -m tethered_toy --deed=... --tether.notes=..."""

import os
import signal
import sys
import time

from hydroviews.cli.commands import run_command
from hydroviews.errors import InputError
from leaderboard.runs.supervision import Tether, tethered


def fails(error: BaseException) -> None:
    raise error


DEEDS = {
    "works": lambda: None,
    "exits with 0": lambda: os._exit(0),
    "exits with 130": lambda: os._exit(130),
    "calls sys.exit": lambda: sys.exit(0),
    "interrupts itself": lambda: fails(KeyboardInterrupt()),
    "is killed": lambda: os.kill(os.getpid(), signal.SIGKILL),
    "raises": lambda: fails(ArithmeticError("step 7")),
    "refuses": lambda: fails(InputError("no such camera")),
    "eats memory": lambda: bytearray(10**9),
    "hangs": lambda: time.sleep(600),
    "holds the lock": lambda: sum(range(10**12)),  # Python's, so that no other thread runs
}


def main(deed: str, tether: Tether) -> None:
    with tethered(tether):
        DEEDS[deed]()


if __name__ == "__main__":
    if "--portable" in sys.argv:
        sys.argv.remove("--portable")
        sys.platform = "another"  # without prctl
    run_command(main, prog="toy")
