"""The one schema of a result: a record a run, a row a record."""

import dataclasses
import logging
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import hydroviews
from hydroviews.errors import InputError, unknown_name
from hydroviews.files.atomic import read_json, replacing, write_json
from hydroviews.metrics import find_metrics

if TYPE_CHECKING:  # every run imports this file, and none but those that gather records needs it
    import pandas as pd

logger = logging.getLogger(__name__)

RECORD = "record.json"
LEADERBOARD = "leaderboard.csv"  # in a results folder

GIVEN_POSES, SPARSE_VIEWS = "given-poses", "sparse-views"
TRACKS = (GIVEN_POSES, SPARSE_VIEWS)  # cameras of the clean capture; the same, with a third of the training views


@dataclass(frozen=True)
class Record:
    """One run. A number that could not be had is None, with the reason; never zero, never invented."""

    method: str
    scene: str
    effect: str  # raindrop, streak, storm, captured or clean
    pattern: str
    seed: int
    track: str  # one of TRACKS
    status: str  # done or failed
    reason: str  # why a number is missing
    n_train: int
    n_test: int
    width: int
    height: int
    scores: Mapping[str, float] = field(default_factory=dict)  # by metric, means over held-out views, where it has one
    train_s: float | None = None
    render_fps: float | None = None
    peak_mem_mb: float | None = None  # resident memory of the run's process, 10^6 bytes
    peak_gpu_mem_mb: float | None = None  # what torch allocated on the GPU, 10^6 bytes; None where it used none
    n_primitives: int | None = None
    model_mb: float | None = None
    device: str = ""  # that trained: "cpu" or the GPU's name
    render_device: str = ""  # that rendered, to which `render_fps` belongs
    simd: str = ""  # the processor's instructions that the kernels of the CPU use, see `kernels/simd.py`
    used: str = ""  # what the method found that the photographs call for, if it looks
    profile: str = ""
    version: str = ""
    data_sha256: str = ""
    drawing_code: str = ""  # digest of the code that drew the rain, or the clean views; empty for photographs


FIELDS = [field.name for field in dataclasses.fields(Record)]


def columns() -> list[str]:
    """Those of a record written down: its fields, with a column a metric in place of the scores."""
    at = FIELDS.index("scores")
    return [*FIELDS[:at], *(metric.name for metric in find_metrics()), *FIELDS[at + 1 :]]


def as_row(record: Record) -> dict[str, Any]:
    """A record by its columns; a metric without a score is None."""
    return {name: record.scores.get(name) if name not in FIELDS else getattr(record, name) for name in columns()}


def from_row(row: Mapping[str, Any]) -> Record:
    """The record that was written as a row; scores of metrics that are not registered here are dropped.

    Raises:
        TypeError: fields are missing, or there are others that are no scores.
    """
    scores = {name: value for name, value in row.items() if name not in FIELDS}
    unknown = [name for name, value in scores.items() if not isinstance(value, float | int | None)]
    if unknown:
        raise TypeError(f"unknown fields: {', '.join(unknown)}")
    known = {metric.name for metric in find_metrics()}
    fields = {name: value for name, value in row.items() if name in FIELDS}
    return Record(
        **fields, scores={name: value for name, value in scores.items() if name in known and value is not None}
    )


def check_track(name: str) -> None:
    """Refuse a track that there is not.

    Raises:
        InputError: it is none of TRACKS.
    """
    if name not in TRACKS:
        raise unknown_name(f"TRACK={name}", name, "track", TRACKS)


def run_folder(results: Path, profile: str, method: str, scene: str, pattern: str, seed: int, track: str) -> Path:
    """Where a run's files go; `package.module:Class` becomes a plain folder name."""
    last = f"seed-{seed}" if track == GIVEN_POSES else f"seed-{seed}-{track}"
    return results / profile / method.replace(":", ".") / scene / pattern / last


def _record_folder(results: Path, record: Record) -> Path:
    names = ("profile", "method", "scene", "pattern", "seed", "track")
    return run_folder(results, **{name: getattr(record, name) for name in names})


def write_record(folder: Path, record: Record) -> None:
    """Write a run's record."""
    write_json(folder / RECORD, as_row(record))


def read_record(path: Path) -> Record:
    """Read a record.

    Raises:
        InputError: missing fields or unknown ones.
    """
    value = read_json(path)
    try:
        return from_row(value)
    except TypeError as error:
        raise InputError(
            f"{path}: not a record of this version", found=error, fix="delete the run and evaluate again"
        ) from None


def collect(results: Path) -> "pd.DataFrame":
    """All records of a results folder, one row each, in the order of `columns`.

    Only records that lie where their run belongs count, so that copies kept beside them do not count twice. An
    unreadable one is left out with a warning.
    """
    import pandas as pd

    records = []
    for path in sorted(results.glob(f"*/*/*/*/*/{RECORD}")):
        try:
            record = read_record(path)
        except InputError as error:
            logger.warning("left out: %s", error)
            continue
        if path.parent == _record_folder(results, record):
            records.append(as_row(record))
    table = pd.DataFrame(records, columns=columns())
    return table.sort_values(["profile", "scene", "track", "effect", "pattern", "method", "seed"], ignore_index=True)


def write_leaderboard(results: Path) -> "pd.DataFrame":
    """Gather every record into `results/leaderboard.csv`; numbers that are missing stay empty.

    Raises:
        InputError: there is no record.
    """
    table = collect(results)
    if table.empty:
        raise InputError(f"{results}: no finished run", fix="run `make eval METHOD=3dgs` first")
    with replacing(results / LEADERBOARD) as temporary:
        table.to_csv(temporary, index=False)
    return table


def code_version() -> str:
    """The package version, with the commit where it runs from a checkout, and "-dirty" if that was changed."""
    checkout = Path(hydroviews.__file__).resolve().parent.parent

    def git(*arguments: str) -> str:
        command = ["git", "-C", str(checkout), *arguments]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()

    try:
        if Path(git("rev-parse", "--show-toplevel")).resolve() != checkout:  # installed into somebody else's
            return hydroviews.__version__
        commit = git("describe", "--always", "--dirty", "--exclude=*")
    except (OSError, subprocess.CalledProcessError):
        return hydroviews.__version__
    return f"{hydroviews.__version__}+{commit}"
