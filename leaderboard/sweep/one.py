"""One run of a sweep, as a process of its own: `local` starts this for every run."""

import dataclasses

from hydroviews.cli.commands import run_command
from leaderboard.evaluate import carry_out
from leaderboard.runs.run import Run
from leaderboard.runs.supervision import Limits, Tether, tethered


def options(run: Run, limits: Limits) -> list[str]:
    """A run and its limits on a command line."""
    fields: dict[str, Run | Limits] = {"run": run, "limits": limits}
    return [
        f"--{prefix}.{field.name.replace('_', '-')}={value}"
        for prefix, given in fields.items()
        for field in dataclasses.fields(given)
        if (value := getattr(given, field.name)) is not None
    ]


def main(run: Run, limits: Limits, tether: Tether) -> None:
    """Train, render and score one run on a scene that is built, unless it is done."""
    with tethered(tether):
        carry_out(run, limits)


if __name__ == "__main__":
    run_command(main, prog="leaderboard.sweep.one")
