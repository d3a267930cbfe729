"""One run of a sweep as a task of a cluster: the script that `slurm` writes starts this for every run."""

import sys

from hydroviews.cli.commands import run_command
from leaderboard.evaluate import carry_out
from leaderboard.records import FAILED
from leaderboard.runs.run import Run
from leaderboard.runs.supervision import Limits


def main(run: Run, limits: Limits) -> None:
    """Train, render and score one run on a scene that is built, and write no tables; exit status 1 if it fails.

    Args:
        run: its method, pattern, seed and folders.
        limits: of its process.
    """
    if carry_out(run, limits).status == FAILED:
        sys.exit(1)


if __name__ == "__main__":
    run_command(main, prog="leaderboard.sweep.task")
