"""The whole benchmark in one call: a scene, rain, a method, the two reference rows, a table.

build what is missing -> for every variant: train, render to disk, score -> records -> tables

A run: `carry_out` keeps a record that is done, else `_train_and_score`; `_train_in_process` guards the run's settings;
`_train_on_copies` lends the training views and starts `runs.train_and_render`, a child process under the limits of
`runs.supervision`; then `scoring.score` reads the renders.
"""

import dataclasses
import logging
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import tyro

from baselines.method import find_method
from hydroviews.dataset.clean_views import CLEAN
from hydroviews.dataset.sources import build_source
from hydroviews.dataset.variants import has_ceiling, is_captured
from hydroviews.errors import InputError
from hydroviews.files import ownership
from hydroviews.files.atomic import write_bytes
from hydroviews.files.locks import BUSY, locked
from hydroviews.formats.capture_json import CAPTURED
from hydroviews.formats.photographs import some
from hydroviews.metrics import find_metrics
from hydroviews.profiles import Profile, find_profile
from hydroviews.rain.registry import choose_patterns
from hydroviews.scene.scenes import Scene
from leaderboard.gather import collect, trusted_record, write_leaderboard
from leaderboard.records import (
    CEILING,
    DONE,
    FAILED,
    FLOOR,
    LEADERBOARD,
    RAINY_POSES,
    RECORD,
    Record,
    check_track,
    write_record,
)
from leaderboard.runs.own_files import PREDICTION, RENDERS, clear_the_way, left_by_the_method
from leaderboard.runs.probe import probe
from leaderboard.runs.run import CONFIG, Run, claim_folder
from leaderboard.runs.run_options import MethodName, RunOptions
from leaderboard.runs.supervision import Limits, Watch, end_gently, run_tethered
from leaderboard.scoring.score import UnusableRun, describe, score
from leaderboard.tables.markdown import scene_text

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class EvaluateRequest(RunOptions):
    """A method and a scene to evaluate."""

    method: tyro.conf.Positional[MethodName]  # a registered name, or package.module:Class; NAME+WRAPPER wraps a method
    scene: str = "courtyard"  # a name that `hydroviews download` lists, or a folder
    seed: int = 0  # seed of the method; the data set keeps its own seed
    overwrite: bool = False  # replace scenes and runs that have other settings


def evaluate_command(request: tyro.conf.OmitArgPrefixes[EvaluateRequest]) -> None:
    """Run a method and the reference rows on a scene, building what is missing; print and write the tables."""
    records = evaluate(request)
    print(f"\n{outcome(records[-1], request.results)}")
    if any(record.status != DONE for record in records):
        sys.exit(1)


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
    limits = request.limits
    profile = find_profile(request.profile)
    probe(request.method, profile.name)
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
        if not has_ceiling(folder):
            _refuse_clean(request.method, folder)
            logger.info("%s: its training views have no clean photographs: no row of %s", scene, CEILING)
    records = {}
    try:
        for run in plan(request, profile, data, scene, names):
            records[run] = carry_out(run, limits, request.overwrite)
    finally:  # whatever ended stands in the table, also if the rest was interrupted
        if records:
            write_leaderboard(request.results)
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

    A method that sees clean views needs no floor; a scene that has none to train on has no ceiling.
    """
    methods = [CEILING, FLOOR] if find_method(request.method).trains_on == "rainy" else []
    methods = [method for method in methods if method != CEILING or CAPTURED not in rainy or has_ceiling(data / scene)]
    methods += [request.method] if request.method not in methods else []
    return [
        Run(method, profile.name, request.seed, data, scene, pattern, request.results, request.track)
        for method in methods
        for pattern in needed_patterns(method, rainy)
    ]


def carry_out(run: Run, limits: Limits, overwrite: bool = False) -> Record:
    """Train, render and score one run, or keep the record it already has; a failed run is tried again.

    While another process is at it, wait: evaluations side by side share the reference rows.
    """
    with locked(run.folder, BUSY):
        claim_folder(run, overwrite)
        record = kept_record(run)
        if record is None:
            return _train_and_score(run, limits)
    kept = "%s: kept, %s (version %s; remove %s to run it again)"
    logger.info(kept, run, figures(record), record.version, run.folder)
    return record


def kept_record(run: Run) -> Record | None:
    """The record of a run that is done; None where there is none, or one that cannot be trusted."""
    if not (run.folder / RECORD).is_file():
        return None
    try:
        record = trusted_record(run.folder)
    except InputError as error:
        logger.warning("%s: not kept: %s", run, error)
        return None
    return record if record.status == DONE else None


def _train_and_score(run: Run, limits: Limits) -> Record:
    reason = run.estimate().reason if run.track == RAINY_POSES else ""
    if reason:
        return _record_failure(run, run.given_scene(), reason)
    logger.info("%s: training", run)
    if not (run.folder / PREDICTION).is_file() or not (run.folder / RENDERS).is_dir():
        reason = _train_in_process(run, limits)
        if reason:
            return _record_failure(run, run.training_scene(), reason)
    try:
        record = score(run)
    except UnusableRun as error:
        return _record_failure(run, run.training_scene(), str(error))
    logger.info("%s: %s", run, figures(record))
    return record


def _train_in_process(run: Run, limits: Limits) -> str:
    """Run `train_and_render` in a process of its own, so that memory is its own and a crash is only its own.

    Returns:
        Why it failed, or "".

    Raises:
        InputError: something that is not the method's the user can mend, such as a full disk.
        KeyboardInterrupt, SystemExit: this process was interrupted; the run left a checkpoint.
    """
    config = run.folder / CONFIG
    settings = config.read_bytes()
    clear_the_way(run.folder)
    with ownership.adopting(run.folder):
        reason = _train_on_copies(run, limits)
    if left := clear_the_way(run.folder):
        reason = reason or left_by_the_method(left)
    if not config.is_file() or config.read_bytes() != settings:
        write_bytes(config, settings)
        (run.folder / PREDICTION).unlink(missing_ok=True)
        return reason or f"the method removed or changed the {CONFIG} of its run"
    return reason


def _train_on_copies(run: Run, limits: Limits) -> str:
    """The process gets copies of the training views alone; held-out pictures are opened when it has ended."""
    with run.lent() as (lent, loan), tempfile.TemporaryDirectory(prefix="hydroviews-run-") as notes:
        options = [f"--run.{field.name}={getattr(lent, field.name)}" for field in dataclasses.fields(lent)]
        watch = Watch(limits, [Path(notes), run.folder])
        reason = run_tethered(
            "leaderboard.runs.train_and_render", options, Path(notes), watch, end_gently, limits.memory
        )
        spoilt = loan.spoilt()
    return f"wrote into the data that it was lent: {some(spoilt)}" if spoilt else reason


def _record_failure(run: Run, scene: Scene, reason: str) -> Record:
    record = describe(run, scene, status=FAILED, reason=reason, numbers={})
    write_record(run.folder, record)
    logger.warning("%s: failed: %s", run, record.reason)
    return record


def _refuse_clean(method: str, folder: Path) -> None:
    if find_method(method).trains_on == "clean":
        raise InputError(
            f"METHOD={method}: learns from clean views, and {folder.name} was taken in rain, without them",
            fix=f"choose a method that learns from rainy views, such as {FLOOR}",
        )


def figures(record: Record) -> str:
    """The scores of a record in one line, or why it has none."""
    if record.pattern == CAPTURED and not record.scores:
        return f"not scored, {record.reason}"
    parts = []
    for metric in find_metrics():
        value = record.scores.get(metric.name)
        parts.append(f"{metric.title} " + ("-" if value is None else f"{metric.text(value)} {metric.unit}".rstrip()))
    return ", ".join(parts)
