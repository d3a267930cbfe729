"""The whole benchmark in one call: a scene, rain, a method, the two reference rows, a table.

build what is missing -> for every variant: train, render to disk, score -> records -> tables
"""

import signal
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from baselines.method import find_method
from hydroviews.build import CLEAN
from hydroviews.errors import InputError
from hydroviews.files import read_json
from hydroviews.profiles import Profile, find_profile
from hydroviews.rain.patterns import choose_patterns
from hydroviews.sources import build_source
from hydroviews.variants import open_clean
from leaderboard.predict import PREDICTION
from leaderboard.records import RECORD, Record, read_record, write_leaderboard, write_record
from leaderboard.runs import Run, claim
from leaderboard.score import describe, score
from leaderboard.tables import print_scene, write_tables

CEILING, FLOOR = "3dgs-clean", "3dgs"  # every result reads as a share of the gap between these two
FAILURE = "failure.json"


@dataclass(frozen=True)
class Evaluation:
    """What to evaluate."""

    method: str  # a registered name, or package.module:Class
    scene: str = "courtyard"  # a known capture, or a folder
    profile: str = "demo"  # demo, quick or paper
    seed: int = 0  # of the method; the data set keeps the seed it was built with
    patterns: tuple[str, ...] = ()  # such as raindrop-0 streak-2; the profile's patterns where none is named
    data: Path = Path("data")
    results: Path = Path("results")
    overwrite: bool = False  # run anew what has other settings


def evaluate(request: Evaluation) -> list[Record]:
    """Build what is missing, run the method and the references, write and print the tables.

    Returns:
        The records of the method that was asked for.

    Raises:
        InputError: something the user can mend.
    """
    profile = find_profile(request.profile)
    names = [pattern.name for pattern in choose_patterns(request.patterns, profile.patterns)]
    patterns = needed_patterns(request.method, names)
    data = request.data / profile.name
    rainy = [name for name in patterns if name != CLEAN]
    scene = build_source(request.scene, data, profile, patterns=rainy).name
    runs = plan(request, profile, data, scene, names)
    records = {run: carry_out(run, request.overwrite and run.method == request.method) for run in runs}
    table = write_leaderboard(request.results)
    write_tables(table, request.results)
    print_scene(table, scene, profile.name)
    print(f"\nall runs: {request.results / 'leaderboard.csv'}")
    return [record for run, record in records.items() if run.method == request.method]


def needed_patterns(method: str, rainy: list[str]) -> list[str]:
    """The variants a method runs on: all rainy ones, or the clean views once."""
    return [CLEAN] if find_method(method).trains_on == "clean" else rainy


def plan(request: Evaluation, profile: Profile, data: Path, scene: str, rainy: list[str]) -> list[Run]:
    """The runs in order: ceiling, floor, then the method; a method that sees clean views needs no floor."""
    methods = [CEILING, FLOOR] if find_method(request.method).trains_on == "rainy" else []
    methods += [request.method] if request.method not in methods else []
    return [
        Run(method, profile.name, request.seed, data, scene, pattern, request.results)
        for method in methods
        for pattern in needed_patterns(method, rainy)
    ]


def carry_out(run: Run, overwrite: bool = False) -> Record:
    """Predict and score one run, or keep the record it already has; a failed run is tried again."""
    claim(run, overwrite)
    if (run.folder / RECORD).is_file():
        record = read_record(run.folder / RECORD)
        if record.status == "done":
            print(f"{run}: kept, {_figures(record)}")
            return record
    print(f"{run}: training")
    if not (run.folder / PREDICTION).is_file():
        reason = _predict_in_process(run)
        if reason:
            return _record_failure(run, reason)
    record = score(run)
    print(f"{run}: {_figures(record)}")
    return record


def _predict_in_process(run: Run) -> str:
    """Run `predict` in a process of its own, so that memory is its own and a crash is only its own.

    Returns:
        Why it failed, or "".

    Raises:
        InputError: the run met something the user can mend.
        KeyboardInterrupt: the run was interrupted; it left a checkpoint.
    """
    (run.folder / FAILURE).unlink(missing_ok=True)
    command = [sys.executable, "-m", "leaderboard", "predict", "--run.method", run.method, "--run.profile", run.profile]
    command += ["--run.seed", str(run.seed), "--run.data", str(run.data), "--run.scene", run.scene]
    command += ["--run.pattern", run.pattern, "--run.results", str(run.results)]
    process = subprocess.Popen(command)
    try:
        code = process.wait()
    except KeyboardInterrupt:
        process.wait()  # the terminal sent it the same signal: let it save its checkpoint
        raise
    if code == 0:
        return ""
    failure = read_json(run.folder / FAILURE) if (run.folder / FAILURE).is_file() else {}
    if failure.get("kind") == "input":
        raise InputError(failure["reason"])
    if code in (130, -signal.SIGINT):
        raise KeyboardInterrupt
    if code < 0:
        return f"ended by {signal.Signals(-code).name}" + (" (out of memory?)" if code == -signal.SIGKILL else "")
    return failure.get("reason", f"exit status {code}")


def _record_failure(run: Run, reason: str) -> Record:
    record = describe(run, open_clean(run.data / run.scene), status="failed", reason=reason, numbers={})
    write_record(run.folder, record)
    print(f"{run}: failed: {reason}", file=sys.stderr)
    return record


def _figures(record: Record) -> str:
    parts = [
        ("PSNR", record.psnr, "{:.2f} dB"),
        ("SSIM", record.ssim, "{:.4f}"),
        ("LPIPS", record.lpips_alex, "{:.4f}"),
    ]
    return ", ".join(f"{name} " + (form.format(value) if value is not None else "-") for name, value, form in parts)
