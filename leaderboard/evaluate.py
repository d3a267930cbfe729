"""The whole benchmark in one call: a scene, rain, a method, the two reference rows, a table.

build what is missing -> for every variant: train, render to disk, score -> records -> tables
"""

import dataclasses
import logging
import signal
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from baselines.method import METHODS, find_method
from hydroviews.cli.commands import choices
from hydroviews.cli.plugins import registered
from hydroviews.cli.processes import run_child
from hydroviews.dataset.clean_views import CLEAN
from hydroviews.dataset.sources import build_source
from hydroviews.dataset.variants import is_captured
from hydroviews.errors import InputError
from hydroviews.files.atomic import read_json
from hydroviews.files.locks import BUSY, locked
from hydroviews.formats.capture_json import CAPTURED
from hydroviews.formats.photographs import some
from hydroviews.metrics import find_metrics
from hydroviews.profiles import PROFILES, Profile, find_profile
from hydroviews.rain.registry import choose_patterns, pattern_names
from leaderboard.predict import FAILURE, PREDICTION
from leaderboard.records import (
    GIVEN_POSES,
    LEADERBOARD,
    RECORD,
    TRACKS,
    Record,
    check_track,
    collect,
    read_record,
    write_leaderboard,
    write_record,
)
from leaderboard.runs import Run, claim_folder
from leaderboard.score import describe, score
from leaderboard.tables import CEILING, FLOOR, scene_text, write_tables

logger = logging.getLogger(__name__)

INPUT = 2  # exit status of a run that met bad input, see `predict`
GRACE, PATIENCE = 3.0, 30.0  # seconds until an interrupted run gets SIGTERM, and until it is killed


MethodName = Annotated[str, choices(registered(METHODS), "package.module:Class")]
ProfileName = Annotated[str, choices(PROFILES)]
TrackName = Annotated[str, choices(TRACKS)]
PatternNames = Annotated[tuple[str, ...], choices(pattern_names(), "package.module:Class-0")]


@dataclass(frozen=True)
class EvaluateRequest:
    """What to evaluate."""

    method: MethodName  # a registered name, or package.module:Class; NAME+WRAPPER wraps it
    scene: str = "courtyard"  # one that `python -m hydroviews scenes` lists, or a folder
    profile: ProfileName = "demo"
    seed: int = 0  # of the method; the data set keeps the seed it was built with
    track: TrackName = GIVEN_POSES  # or sparse-views: a third of the training views
    patterns: PatternNames = ()  # 0 is light, 1 medium, 2 heavy; the profile's patterns if none is named
    data: Path = Path("data")
    results: Path = Path("results")
    captures: Path | None = None  # the folder with published captures; $HYDROVIEWS_CAPTURES if not given
    overwrite: bool = False  # build and run anew what is there with other settings


def evaluate(request: EvaluateRequest) -> list[Record]:
    """Build what is missing, run the method and the references, write the tables.

    Returns:
        The records of the method and of the reference rows.

    Raises:
        InputError: something the user can mend.
    """
    if request.seed < 0:
        raise InputError(f"SEED={request.seed}: negative", expected="0 or more")
    check_track(request.track)
    profile = find_profile(request.profile)
    names = [pattern.name for pattern in choose_patterns(request.patterns, profile.patterns)]
    data = request.data / profile.name
    rainy = [name for name in needed_patterns(request.method, names) if name != CLEAN]
    folder = build_source(
        request.scene,
        data,
        profile,
        patterns=request.patterns if rainy else (),
        all_patterns=bool(rainy),
        overwrite=request.overwrite,
        captures=request.captures,
    )
    scene = folder.name
    if is_captured(folder):
        names = [CAPTURED]
        _refuse_clean(request.method, folder)
    records = {}
    try:
        for run in plan(request, profile, data, scene, names):
            records[run] = carry_out(run, request.overwrite)
    finally:  # whatever ended stands in the table, also if the rest was interrupted
        if records:
            write_tables(write_leaderboard(request.results), request.results)
    return list(records.values())


def outcome(record: Record, results: Path) -> str:
    """The table that a record stands in, and where all runs are, to be printed."""
    text = scene_text(collect(results), record.scene, record.profile, record.track)
    return f"{text}\nall runs: {results / LEADERBOARD}"


def needed_patterns(method: str, rainy: list[str]) -> list[str]:
    """The variants a method runs on: all rainy ones, or the clean views once."""
    return [CLEAN] if find_method(method).trains_on == "clean" else rainy


def plan(request: EvaluateRequest, profile: Profile, data: Path, scene: str, rainy: list[str]) -> list[Run]:
    """The runs in order: ceiling, floor, then the method.

    A method that sees clean views needs no floor; a scene that has none has no ceiling.
    """
    methods = [CEILING, FLOOR] if find_method(request.method).trains_on == "rainy" else []
    methods = [method for method in methods if method != CEILING or CAPTURED not in rainy]
    methods += [request.method] if request.method not in methods else []
    return [
        Run(method, profile.name, request.seed, data, scene, pattern, request.results, request.track)
        for method in methods
        for pattern in needed_patterns(method, rainy)
    ]


def carry_out(run: Run, overwrite: bool = False) -> Record:
    """Train, render and score one run, or keep the record it already has; a failed run is tried again.

    While another process is at it, wait: evaluations side by side share the reference rows.
    """
    with locked(run.folder, BUSY):
        return _carry_out(run, overwrite)


def _carry_out(run: Run, overwrite: bool) -> Record:
    claim_folder(run, overwrite)
    if (run.folder / RECORD).is_file():
        record = read_record(run.folder / RECORD)
        if record.status == "done":
            kept = "%s: kept, %s (version %s; remove %s to run it again)"
            logger.info(kept, run, _figures(record), record.version, run.folder)
            return record
    logger.info("%s: training", run)
    if not (run.folder / PREDICTION).is_file() or not (run.folder / "renders").is_dir():
        reason = _train_in_process(run)
        if reason:
            return _record_failure(run, reason)
    record = score(run)
    logger.info("%s: %s", run, _figures(record))
    return record


def _train_in_process(run: Run) -> str:
    """Run `train_and_render` in a process of its own, so that memory is its own and a crash is only its own.

    It gets copies of the training views alone; held-out pictures are opened when it has ended.

    Returns:
        Why it failed, or "".

    Raises:
        InputError: the run met something the user can mend.
        KeyboardInterrupt: the run was interrupted; it left a checkpoint.
    """
    (run.folder / FAILURE).unlink(missing_ok=True)
    with run.lent() as (lent, loan):
        settings = [f"--run.{field.name}={getattr(lent, field.name)}" for field in dataclasses.fields(lent)]
        code = run_child([sys.executable, "-m", "leaderboard.predict", *settings], _end)
        spoilt = loan.spoilt() if code in (0, INPUT) else []
    if spoilt:
        return f"wrote into the data that it was lent: {some(spoilt)}"
    if code == 0:
        return ""
    failure = read_json(run.folder / FAILURE) if (run.folder / FAILURE).is_file() else {}
    if failure.get("kind") == "input":
        raise InputError(failure["reason"])
    if code in (130, 143, -signal.SIGINT, -signal.SIGTERM):
        raise KeyboardInterrupt
    if code < 0:
        return f"ended by {signal.Signals(-code).name}" + (" (out of memory?)" if code == -signal.SIGKILL else "")
    return failure.get("reason", f"exit status {code}")


def _end(process: subprocess.Popen) -> None:
    """Wait until a run has saved and stopped: a terminal has sent it the same Ctrl-C; otherwise it gets SIGTERM."""
    for patience, stop in ((GRACE, process.terminate), (PATIENCE, process.kill)):
        try:
            process.wait(patience)
        except subprocess.TimeoutExpired:
            stop()


def _record_failure(run: Run, reason: str) -> Record:
    record = describe(run, run.training_scene(), status="failed", reason=reason, numbers={})
    write_record(run.folder, record)
    logger.warning("%s: failed: %s", run, reason)
    return record


def _refuse_clean(method: str, folder: Path) -> None:
    if find_method(method).trains_on == "clean":
        raise InputError(
            f"METHOD={method}: learns from clean views, and {folder.name} was taken in rain",
            fix=f"choose a method that learns from rainy views, such as {FLOOR}",
        )


def _figures(record: Record) -> str:
    if record.pattern == CAPTURED:
        return f"not scored, {record.reason}"
    parts = []
    for metric in find_metrics():
        value = record.scores.get(metric.name)
        parts.append(f"{metric.title} " + ("-" if value is None else f"{metric.text(value)} {metric.unit}".rstrip()))
    return ", ".join(parts)
