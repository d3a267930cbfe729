"""The checks of a contract, tried one after another in a process of their own: see `check`, which starts it."""

import dataclasses
import json
import time
import traceback
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from baselines.method import find_method
from hydroviews.cli.commands import run_command
from leaderboard.contract import checks, interruptions
from leaderboard.contract.case import Case, Failed, NotTestable
from leaderboard.runs.supervision import Tether, tethered

CHECKS: dict[str, Callable[[Case], str]] = {
    "found by its name": checks.found,
    "configurations": checks.configurations,
    "trains": checks.training,
    "renders any camera": checks.rendering,
    "saved and loaded": checks.saving,
    "summary": checks.summary,
    "same seed, same result": checks.same_seed,
    "held-out views unseen": checks.held_out,
    "masks respected": checks.masks,
    "bad photographs refused": checks.unreadable,
    "fitted twice": checks.fitted_twice,
    "other checkpoints refused": checks.foreign,
    "nothing left running": interruptions.nothing_left,
    "Ctrl-C and on": interruptions.ctrl_c,
    "SIGTERM and on": interruptions.termination,
}
BASIC = ("configurations", "trains")  # without these there is nothing to check the others on


class Result(StrEnum):
    """What a check can end with."""

    PASSED = "passed"
    FAILED = "failed"
    NOT_TESTABLE = "not testable"


@dataclass(frozen=True)
class Outcome:
    """Of one check."""

    check: str
    result: Result
    reason: str  # what was seen, or why it failed or could not be tested
    seconds: float = 0.0
    trace: str = ""  # of an exception that is no verdict

    @property
    def ends_all(self) -> bool:
        """Whether the other checks cannot be made after this one."""
        return self.check in BASIC and self.result == Result.FAILED


def try_checks(case: Case, names: Iterable[str]) -> Iterator[Outcome]:
    """Checks in order, until a basic one has failed."""
    for name in names:
        outcome = try_check(case, name, CHECKS[name])
        yield outcome
        if outcome.ends_all:
            return


def try_check(case: Case, name: str, function: Callable[[Case], str]) -> Outcome:
    """One check."""
    start, trace = time.perf_counter(), ""
    try:
        result, reason = Result.PASSED, function(case)
    except NotTestable as why:
        result, reason = Result.NOT_TESTABLE, str(why)
    except Failed as why:
        result, reason = Result.FAILED, str(why)
    except Exception as error:  # whatever a method does
        result, reason, trace = Result.FAILED, f"{type(error).__name__}: {error}", traceback.format_exc()
    return Outcome(name, result, " ".join(reason.split()), round(time.perf_counter() - start, 2), trace)


def main(method: str, profile: str, steps: int, folder: Path, names: list[str], told: Path, tether: Tether) -> None:
    """Try checks on a method.

    Args:
        method: its name.
        profile: whose configuration is shortened.
        steps: of training.
        folder: for everything that is written.
        names: of the checks.
        told: file that gets a line of JSON an outcome.
        tether: to the process that waits for them.
    """
    with tethered(tether), told.open("a") as file:
        for outcome in try_checks(Case(method, find_method(method), profile, steps, folder), names):
            print(json.dumps(dataclasses.asdict(outcome)), file=file, flush=True)


if __name__ == "__main__":
    run_command(main, prog="leaderboard.contract.trials")
