"""Does a method keep its contract? A short training or two on a small room, and a line a promise."""

import contextlib
import dataclasses
import logging
import os
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from tqdm import tqdm

from baselines.method import find_method
from baselines.training.devices import VARIABLE, missing_for_cuda
from hydroviews.errors import InputError
from hydroviews.files.atomic import write_json
from hydroviews.profiles import find_profile
from leaderboard.contract import checks, interruptions
from leaderboard.contract.case import Case, Failed, NotTestable

logger = logging.getLogger(__name__)

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


def check(method: str, profile: str = "demo", steps: int = 30, report: Path | None = None) -> list[Outcome]:
    """Check a method, print a line a check, and write them all as JSON if asked to.

    Args:
        method: a registered name, or package.module:Class.
        profile: whose configuration is shortened.
        steps: of training, where the configuration counts them; the interrupted ones take some seconds.
        report: the JSON file.

    Raises:
        InputError: no such method or profile, or no steps.
    """
    if steps < 1:
        raise InputError(f"--steps {steps}: too few", expected="1 or more")
    kind = find_method(method)
    with on_the_cpu(), tempfile.TemporaryDirectory(prefix="hydroviews-check-") as folder:
        outcomes = run_checks(Case(method, kind, find_profile(profile).name, steps, Path(folder)))
    counts = Counter(outcome.result for outcome in outcomes)
    logger.info("\n%s: %s", method, ", ".join(f"{counts[result]} {result}" for result in Result))
    for outcome in outcomes:
        if outcome.trace:
            logger.info("\n%s:\n%s", outcome.check, outcome.trace.rstrip())
    if report:
        told = [dataclasses.asdict(outcome) for outcome in outcomes]
        passed = not counts[Result.FAILED]
        write_json(report, {"method": method, "profile": profile, "steps": steps, "passed": passed, "checks": told})
    return outcomes


@contextlib.contextmanager
def on_the_cpu() -> Iterator[None]:
    """While it lasts, methods train on the CPU, where promises hold to the bit; unless $HYDROVIEWS_DEVICE is set."""
    if os.environ.get(VARIABLE):
        yield
        return
    if missing_for_cuda() is None:
        logger.info(f"on the CPU, where the same training gives the same pixels; {VARIABLE}=cuda checks on the GPU")
    os.environ[VARIABLE] = "cpu"
    try:
        yield
    finally:
        del os.environ[VARIABLE]


def run_checks(case: Case) -> list[Outcome]:
    """All checks in order, each printed when it is done; the rest cannot be tested once a basic one has failed."""
    outcomes: list[Outcome] = []
    reason, width = "", max(map(len, CHECKS))
    with tqdm(CHECKS.items(), desc=case.name, unit="check", leave=False, disable=None) as bar:
        for name, function in bar:
            outcome = Outcome(name, Result.NOT_TESTABLE, reason) if reason else try_check(case, name, function)
            logger.info("%s", f"{outcome.result:12}  {name:{width}}  {outcome.reason}")
            outcomes.append(outcome)
            if name in BASIC and outcome.result == Result.FAILED:
                reason = f"failed already: {name}"
    return outcomes


def try_check(case: Case, name: str, function: Callable[[Case], str]) -> Outcome:
    """One check; what the method prints meanwhile goes to a file."""
    start, trace = time.perf_counter(), ""
    try:
        with (
            (case.folder / "output.txt").open("a") as output,
            contextlib.redirect_stdout(output),
            contextlib.redirect_stderr(output),
        ):
            result, reason = Result.PASSED, function(case)
    except NotTestable as why:
        result, reason = Result.NOT_TESTABLE, str(why)
    except Failed as why:
        result, reason = Result.FAILED, str(why)
    except Exception as error:  # whatever a method does
        result, reason, trace = Result.FAILED, f"{type(error).__name__}: {error}", traceback.format_exc()
    return Outcome(name, result, " ".join(reason.split()), round(time.perf_counter() - start, 2), trace)
