"""The one schema of a result: a record a run, a row a record."""

import dataclasses
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, get_args, get_type_hints

import hydroviews
from hydroviews import errors
from hydroviews.errors import InputError, unknown_name
from hydroviews.files.atomic import read_json, write_json
from hydroviews.metrics import find_metrics

RECORD, PER_VIEW = "record.json", "per_view.csv"
LEADERBOARD = "leaderboard.csv"  # in a results folder

DONE, FAILED = "done", "failed"
UNREADABLE = "unreadable"  # stands in tables for a record that cannot be used, and is never written to one
LONGEST = 500  # characters of a reason
LARGEST = 1e300  # what a number may be
RESCORE = "evaluate the run again: its renders are scored anew"

GIVEN_POSES, SPARSE_VIEWS, RAINY_POSES = "given-poses", "sparse-views", "rainy-poses"
# Cameras of the clean capture; the same, with a third of the training views; cameras estimated from what is trained on.
TRACKS = (GIVEN_POSES, SPARSE_VIEWS, RAINY_POSES)


@dataclass(frozen=True)
class Record:
    """One run. A number that could not be had is None, with the reason; never zero, never invented."""

    method: str
    scene: str
    effect: str  # raindrop, streak, storm, captured or clean
    pattern: str
    seed: int
    track: str  # one of TRACKS
    status: str  # done or failed; in tables unreadable as well
    reason: str  # why a number is missing
    n_train: int | None  # None where the record cannot be read, as are the three below
    n_test: int | None
    width: int | None
    height: int | None
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
    photographs: int | None = None  # that cameras were estimated from in the track rainy-poses, as all below
    registered: int | None = None  # of these, with a camera
    pose_auc_5: float | None = None  # see `hydroviews.scene.camera_errors.CameraErrors`
    pose_auc_10: float | None = None
    pose_auc_30: float | None = None
    rotation_error: float | None = None
    position_error: float | None = None

    def __post_init__(self) -> None:
        for name in FREE:
            object.__setattr__(self, name, printable(getattr(self, name)))


FREE = ("reason", "used", "device", "render_device", "version")  # text that a method or an error had a hand in
FIELDS = [field.name for field in dataclasses.fields(Record)]
NEEDED = [field.name for field in dataclasses.fields(Record) if field.default is dataclasses.MISSING]
NEEDED.remove("scores")
NOTED = [*FIELDS[FIELDS.index("train_s") : FIELDS.index("profile")], "version"]  # when it was trained and rendered
KINDS = get_type_hints(Record)


def printable(text: str, longest: int = LONGEST) -> str:
    """Text that any file and terminal can hold: what is cut off is counted, what cannot be printed is escaped."""
    shown = errors.printable(text[:longest])
    if len(text) <= longest and len(shown) <= longest:
        return shown
    end = f" ... ({len(text):,} characters)"
    return shown[: longest - len(end)] + end


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
        ValueError: fields are missing, hold what they cannot, or are others that are no scores; it names them all.
    """
    if not isinstance(row, dict):
        raise ValueError(f"a {type(row).__name__}, expected fields by name")
    fields = {name: value for name, value in row.items() if name in FIELDS and name != "scores"}
    scores = {name: value for name, value in row.items() if name not in fields}
    wrong = [f"no {name}" for name in NEEDED if name not in row]
    wrong += misfits(fields)
    wrong += [f"unknown or odd {_shown(name, value)}" for name, value in scores.items() if not _is_score(value)]
    if row.get("status") not in (DONE, FAILED):
        wrong.append(f"status is none of {DONE}, {FAILED}")
    if wrong:
        raise ValueError("; ".join(wrong))
    known = {metric.name for metric in find_metrics()}
    return Record(
        **fields, scores={name: value for name, value in scores.items() if name in known and value is not None}
    )


def misfits(fields: Mapping[str, Any]) -> list[str]:
    """Those of a record's fields that hold something else than the record's text or finite number, with what they hold.

    Args:
        fields: some of a record's, without scores.
    """
    odd = {name: value for name, value in fields.items() if not _fits(name, value)}
    return [f"{_shown(name, value)}, expected {_kind(name)}" for name, value in odd.items()]


def _fits(name: str, value: Any) -> bool:
    kinds = get_args(KINDS[name]) or (KINDS[name],)
    if _is_number(value):
        return (float in kinds or (int in kinds and isinstance(value, int))) and value >= 0
    return isinstance(value, kinds) and not isinstance(value, int | float)


def _is_score(value: Any) -> bool:
    return value is None or _is_number(value)


def _is_number(value: Any) -> bool:
    """Whether it is a number that every reader takes; NaN and the infinities are none."""
    return isinstance(value, int | float) and not isinstance(value, bool) and -LARGEST < value < LARGEST


def _kind(name: str) -> str:
    return str(KINDS[name]).removeprefix("<class '").removesuffix("'>")


def _shown(name: str, value: Any) -> str:
    return f"{printable(name, 40)} {printable(repr(value), 60)}"


def check_track(name: str) -> None:
    """Refuse a track that there is not.

    Raises:
        InputError: it is none of TRACKS.
    """
    if name not in TRACKS:
        raise unknown_name(f"TRACK={name}", name, "track", TRACKS)


def effect_of(pattern: str) -> str:
    """The effect of a pattern: raindrop, streak, storm, captured or clean."""
    return pattern.rpartition("-")[0] or pattern


def run_folder(results: Path, profile: str, method: str, scene: str, pattern: str, seed: int, track: str) -> Path:
    """Where a run's files go; `package.module:Class` becomes a plain folder name."""
    last = f"seed-{seed}" if track == GIVEN_POSES else f"seed-{seed}-{track}"
    return results / profile / method.replace(":", ".") / scene / pattern / last


def write_record(folder: Path, record: Record) -> None:
    """Write a run's record."""
    write_json(folder / RECORD, as_row(record))


def read_record(path: Path) -> Record:
    """Read a record.

    Raises:
        InputError: no JSON, missing or unknown fields, or values that they cannot hold.
    """
    try:
        return from_row(read_json(path, RESCORE))
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: not a record of this version", found=error, fix=RESCORE) from None


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
