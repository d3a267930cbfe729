"""Does a method keep its contract? A short training or two on a small room, and a line a promise.

The checks run in a process of their own. One that ends it, or takes too long, has failed, and a new process goes on
with those after it.
"""

import contextlib
import dataclasses
import json
import logging
import os
import subprocess
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from tqdm import tqdm

from baselines.training.devices import VARIABLE, missing_for_cuda
from hydroviews.errors import InputError
from hydroviews.files.atomic import write_json
from hydroviews.files.ownership import require_ours
from hydroviews.profiles import find_profile
from leaderboard.contract.trials import CHECKS, Outcome, Result
from leaderboard.records import printable
from leaderboard.runs.supervision import run_tethered

logger = logging.getLogger(__name__)

TRIALS = "leaderboard.contract.trials"  # the process' module
MINUTES = 10.0
LAST_WORDS = 100  # lines of what a process printed before it ended


def check(
    method: str, profile: str = "demo", steps: int = 30, report: Path | None = None, minutes: float = MINUTES
) -> list[Outcome]:
    """Check a method, print a line a check, and write them all as JSON if asked to.

    Args:
        method: a registered name, or package.module:Class.
        profile: whose configuration is shortened.
        steps: of training, where the configuration counts them; the interrupted ones take some seconds.
        report: the JSON file.
        minutes: that a check may take.

    Raises:
        InputError: no such method or profile, no steps or time, or a file of somebody else's has the report's name.
    """
    if steps < 1:
        raise InputError(f"--steps {steps}: too few", expected="1 or more")
    if not minutes > 0:
        raise InputError(f"--minutes {minutes:g}: too few", expected="more than 0")
    require_ours([report] if report else [])
    with on_the_cpu():
        outcomes = run_checks(method, find_profile(profile).name, steps, minutes)
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


def run_checks(method: str, profile: str, steps: int, minutes: float) -> list[Outcome]:
    """All checks in order, each printed when it is done; the rest cannot be tested once a basic one has failed."""
    outcomes: list[Outcome] = []
    options = [f"--method={method}", f"--profile={profile}", f"--steps={steps}"]
    with tqdm(total=len(CHECKS), desc=method, unit="check", leave=False, disable=None) as bar:

        def tell(outcome: Outcome) -> None:
            logger.info("%s", f"{outcome.result:12}  {outcome.check:{max(map(len, CHECKS))}}  {outcome.reason}")
            outcomes.append(outcome)
            bar.update()

        while (left := list(CHECKS)[len(outcomes) :]) and not any(outcome.ends_all for outcome in outcomes):
            _run_some(options, left, minutes, tell)
        reason = f"failed already: {outcomes[-1].check}"
        for name in left:
            tell(Outcome(name, Result.NOT_TESTABLE, reason))
    return outcomes


def _run_some(options: Sequence[str], names: Sequence[str], minutes: float, tell: Callable[[Outcome], None]) -> None:
    """Run checks in a process, as far as it comes; that in which it ends has failed."""
    with tempfile.TemporaryDirectory(prefix="hydroviews-check-") as temporary:
        folder = Path(temporary)
        told, work, output = folder / "told", folder / "work", folder / "output"
        options = [*options, f"--folder={work}", f"--told={told}", "--names", *names]
        follower = Follower(told, minutes, tell)
        with output.open("wb") as file:
            reason = run_tethered(TRIALS, options, folder, follower, subprocess.Popen.kill, output=file)
        follower.read()
        if reason and follower.n < len(names):
            trace = "\n".join(output.read_text(errors="replace").splitlines()[-LAST_WORDS:])
            tell(Outcome(names[follower.n], Result.FAILED, printable(reason), round(follower.seconds, 2), trace))


class Follower:
    """Tells outcomes as a process writes them, and watches that none takes too long."""

    def __init__(self, path: Path, minutes: float, tell: Callable[[Outcome], None]) -> None:
        self._path, self._minutes, self._tell = path, minutes, tell
        self._since = time.monotonic()
        self.n, self.reason = 0, ""

    @property
    def seconds(self) -> float:
        """Since the last outcome."""
        return time.monotonic() - self._since

    def overdue(self) -> bool:
        """Whether the check that is being made has taken too long; says so in `reason`."""
        self.read()
        if self.seconds > 60 * self._minutes:
            self.reason = f"not done after {self._minutes:g} minutes (--minutes allows more)"
        return bool(self.reason)

    def read(self) -> None:
        """Tell what is new."""
        lines = self._path.read_text().splitlines(keepends=True) if self._path.is_file() else []
        for line in lines[self.n :]:
            if line.endswith("\n"):
                outcome = json.loads(line)
                self._tell(Outcome(**{**outcome, "result": Result(outcome["result"])}))
                self.n, self._since = self.n + 1, time.monotonic()
