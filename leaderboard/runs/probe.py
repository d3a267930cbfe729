"""Whether somebody's own method can be imported and configured, tried first in a process of its own.

A module can end the process that imports it, or never come back: then it is this one that pays.
"""

import subprocess
import tempfile
from pathlib import Path

from hydroviews.cli.commands import run_command
from hydroviews.errors import InputError
from leaderboard.runs.run import recorded_configuration
from leaderboard.runs.supervision import Limits, Tether, Watch, run_tethered, tethered

HOURS = 0.2  # that an import may take


def probe(method: str, profile: str) -> None:
    """Import a method and ask for its configuration; registered methods are trusted with this process.

    Raises:
        InputError: there is no such method or profile, it cannot be imported or configured, or that ends a process.
    """
    if ":" in method:
        options = [f"--method={method}", f"--profile={profile}"]
        with tempfile.TemporaryDirectory(prefix="hydroviews-probe-") as notes:
            watch = Watch(Limits(time=HOURS, stall=HOURS), [])
            reason = run_tethered("leaderboard.runs.probe", options, Path(notes), watch, subprocess.Popen.kill)
        if reason:
            raise InputError(f"METHOD={method}: cannot be imported and configured", found=reason)
    recorded_configuration(method, profile)


def main(method: str, profile: str, tether: Tether) -> None:
    """Import a method and ask for its configuration."""
    with tethered(tether):
        recorded_configuration(method, profile)


if __name__ == "__main__":
    run_command(main, prog="leaderboard.runs.probe")
