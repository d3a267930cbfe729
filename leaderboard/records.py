"""The one schema of a result: a record a run, a row a record."""

import dataclasses
import subprocess
from collections.abc import Mapping
from dataclasses import field
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import pydantic
from pydantic import AfterValidator, Field
from pydantic.dataclasses import dataclass

import hydroviews
from hydroviews import errors
from hydroviews.errors import InputError, unknown_name
from hydroviews.files.atomic import read_json, write_json
from hydroviews.metrics import find_metrics

RECORD, PER_VIEW = "record.json", "per_view.csv"
LEADERBOARD = "leaderboard.csv"  # in a results folder; one with the views of all runs is beside it, as PER_VIEW
SUBMITTED = "submitted"  # in the settings of a run that somebody else rendered: by whom, link, hardware
SCHEMA = 2  # of record.json; 1, which had no number, lacks the fields that are marked below

DONE: Final = "done"
PARTIAL: Final = "partial"
FAILED: Final = "failed"
UNREADABLE: Final = "unreadable"  # stands in tables for a record that cannot be used, and is never written to one
SCORED = (DONE, PARTIAL)  # whose numbers count, where they are there
LONGEST = 500  # characters of a reason
LARGEST = 1e300  # what a number may be
VERSIONS_IN_ORDER = ", then "  # between the versions of code that trained a run
RESCORE = "evaluate the run again: its renders are scored anew"

CEILING, FLOOR = "3dgs-clean", "3dgs"  # methods that others stand between: plain 3DGS on clean and on rainy views
GIVEN_POSES, SPARSE_VIEWS, RAINY_POSES = "given-poses", "sparse-views", "rainy-poses"
# Cameras of the clean capture; the same, with a third of the training views; cameras estimated from what is trained on.
TRACKS = (GIVEN_POSES, SPARSE_VIEWS, RAINY_POSES)

Status = Literal["done", "partial", "failed", "unreadable"]


def printable(text: str, longest: int = LONGEST) -> str:
    """Text that any file and terminal can hold: what is cut off is counted, what cannot be printed is escaped."""
    shown = errors.printable(text[:longest])
    if len(text) <= longest and len(shown) <= longest:
        return shown
    end = f" ... ({len(text):,} characters)"
    return shown[: longest - len(end)] + end


STRICT = pydantic.ConfigDict(strict=True, extra="forbid", allow_inf_nan=False)
Free = Annotated[str, AfterValidator(printable)]  # text that a method or an error had a hand in
Count = Annotated[int, Field(ge=0)]
Number = Annotated[float, Field(ge=0, lt=LARGEST)]
Score = Annotated[float, Field(gt=-LARGEST, lt=LARGEST)]


@dataclass(frozen=True, config=STRICT)
class Record:
    """One run. A number that could not be had is None, with the reason; never zero, never invented.

    Raises:
        pydantic.ValidationError: a field holds what it cannot, such as NaN or a number below 0.
    """

    method: str
    scene: str
    effect: str  # raindrop, streak, storm, captured or clean
    pattern: str
    seed: Count
    track: str  # one of TRACKS
    status: Status
    reason: Free  # why a number is missing
    n_train: Count | None  # None where the record cannot be read, as are the three below
    n_test: Count | None
    width: Count | None
    height: Count | None
    scores: Mapping[str, Score] = field(default_factory=dict)  # by metric, means over held-out views
    train_s: Number | None = None
    before_s: Number | None = None  # of `fit`, all sessions: until the first training step; new in schema 2
    after_s: Number | None = None  # and since the last one; new in schema 2
    render_fps: Number | None = None
    peak_mem_mb: Number | None = None  # resident memory of the run's process, 10^6 bytes
    peak_gpu_mem_mb: Number | None = None  # what torch allocated on the GPU, 10^6 bytes; None where it used none
    n_primitives: Count | None = None
    model_mb: Number | None = None
    device: Free = ""  # that trained: "cpu" or the GPU's name
    render_device: Free = ""  # that rendered, to which `render_fps` belongs
    simd: str = ""  # the processor's instructions that the kernels of the CPU use, see `kernels/simd.py`
    used: Free = ""  # what the method found that the photographs call for, if it looks
    workers: Count | None = None  # runs at a time on the machine: seconds are shared where > 1; new in schema 2
    profile: str = ""
    version: Free = ""  # of the code that trained; where it changed between sessions all of them, in order
    sessions: Count | None = None  # how often training was started; new in schema 2
    data_sha256: str = ""
    drawing_code: str = ""  # digest of the code that drew the rain, or the clean views; empty for photographs
    renders_sha256: str = ""  # of the pictures that were scored; new in schema 2
    photographs: Count | None = None  # that cameras were estimated from in the track rainy-poses, as all below
    registered: Count | None = None  # of these, with a camera
    pose_auc_5: Number | None = None  # see `hydroviews.scene.camera_errors.CameraErrors`
    pose_auc_10: Number | None = None
    pose_auc_30: Number | None = None
    rotation_error: Number | None = None
    position_error: Number | None = None
    submitted_by: Free = ""  # who rendered it; empty for runs of our own; new in schema 2
    link: Free = ""  # to what they did; new in schema 2


FIELDS = [field.name for field in dataclasses.fields(Record)]
# What is noted when a run is trained and rendered.
NOTED = [*FIELDS[FIELDS.index("train_s") : FIELDS.index("profile")], "version", "sessions"]
_NEW_NOTES: dict[str, Any] = {"before_s": None, "after_s": None, "sessions": None, "workers": None}  # since schema 2
_types: Any = {f.name: (f.type, ...) for f in dataclasses.fields(Record) if f.name in NOTED}
_Notes = pydantic.create_model("_Notes", __config__=STRICT, **_types)


def columns() -> list[str]:
    """Those of a record written down: its fields, with a column a metric in place of the scores."""
    at = FIELDS.index("scores")
    return [*FIELDS[:at], *(metric.name for metric in find_metrics()), *FIELDS[at + 1 :]]


def as_row(record: Record) -> dict[str, Any]:
    """A record by its columns; a metric without a score is None."""
    return {name: record.scores.get(name) if name not in FIELDS else getattr(record, name) for name in columns()}


def status_of(scores: Mapping[str, float]) -> Status:
    """Done where every metric is there."""
    return DONE if all(metric.name in scores for metric in find_metrics()) else PARTIAL


def from_row(row: Mapping[str, Any]) -> Record:
    """The record that was written as a row, of this schema or an earlier one.

    Scores of metrics that are not registered here are dropped. One that was done and lacks a metric, such as one that
    was registered since, is partial.

    Raises:
        ValueError: fields are missing, hold what they cannot, or are others that are no scores; it names them all.
    """
    if not isinstance(row, dict):
        raise ValueError(f"a {type(row).__name__}, expected fields by name")
    schema = row.get("schema", 1)
    if schema not in range(1, SCHEMA + 1):
        raise ValueError(f"schema {printable(repr(schema), 40)}, expected 1 to {SCHEMA}: written by another version")
    fields = {name: value for name, value in row.items() if name in FIELDS and name != "scores"}
    others = {name: value for name, value in row.items() if name not in fields and name != "schema"}
    try:
        record = Record(**fields, scores={name: value for name, value in others.items() if value is not None})
    except pydantic.ValidationError as error:
        raise ValueError(in_words(error)) from None
    if record.status == UNREADABLE:
        raise ValueError(f"status {UNREADABLE}, expected one that is written down")
    known = {metric.name for metric in find_metrics()}
    scores = {name: value for name, value in record.scores.items() if name in known}
    status = status_of(scores) if scores else record.status  # without any: not scored, or failed
    return dataclasses.replace(record, scores=scores, status=status)


def checked_notes(notes: Any) -> dict[str, Any]:
    """What was noted of a run when it was trained and rendered, by fields of its record.

    Raises:
        ValueError: fields are missing, are others, or hold what they cannot.
    """
    if not isinstance(notes, dict):
        raise ValueError(f"a {type(notes).__name__}, expected fields by name")
    notes = _NEW_NOTES | notes
    try:
        _Notes(**notes)
    except pydantic.ValidationError as error:
        raise ValueError(in_words(error)) from None
    return notes


def in_words(error: pydantic.ValidationError) -> str:
    """What is wrong, in one line: every field that is missing, unknown, or holds what it cannot."""
    return "; ".join(_fault(fault) for fault in error.errors(include_url=False))


def _fault(fault: Any) -> str:
    name = printable(".".join(map(str, fault["loc"])).removeprefix("scores."), 40)
    if fault["type"] == "missing":
        return f"no {name}"
    if fault["type"] in ("extra_forbidden", "unexpected_keyword_argument"):
        return f"unknown {name}"
    told = fault["msg"][:1].lower() + fault["msg"][1:]
    return f"{name} {printable(repr(fault['input']), 60)}: {printable(told, 200)}"


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


LEVELS = 5  # folders below a results folder: profile, method, scene, pattern, seed
PLACE = ("profile", "method", "scene", "pattern", "seed", "track")  # what says where a run's files go


def run_folder(results: Path, profile: str, method: str, scene: str, pattern: str, seed: int, track: str) -> Path:
    """Where a run's files go; `package.module:Class` becomes a plain folder name."""
    last = f"seed-{seed}" if track == GIVEN_POSES else f"seed-{seed}-{track}"
    return results / profile / method.replace(":", ".") / scene / pattern / last


def results_above(folder: Path) -> Path:
    """The results folder that a run's folder lies in; of one that lies too high to be a run's, that folder itself."""
    return [*folder.parents, folder][:LEVELS][-1]


def write_record(folder: Path, record: Record) -> None:
    """Write a run's record."""
    write_json(folder / RECORD, {"schema": SCHEMA, **as_row(record)})


def read_record(path: Path) -> Record:
    """Read a record.

    Raises:
        InputError: no JSON, missing or unknown fields, or values that they cannot hold.
    """
    try:
        return from_row(read_json(path, RESCORE))
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: not a record of this version", found=error, fix=RESCORE) from None


# What a run can depend on of a checkout, as git has paths: packages with their data and weights, and what they need;
# not pages, pictures, or the runs that ship.
CODE = ("hydroviews", "baselines", "deraings", "leaderboard", "pyproject.toml", "constraints.txt")
NO_CODE = ("*.md", "*.png", "*.jpg", "*.svg", "*.webp", "leaderboard/board")


def code_version() -> str:
    """The package version, with the commit where it runs from a checkout, and "-dirty" if its code was changed.

    Files that are not under version control count as well, where they are code.
    """
    checkout = Path(hydroviews.__file__).resolve().parent.parent

    def git(*arguments: str) -> str:
        command = ["git", "-C", str(checkout), *arguments]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()

    try:
        if Path(git("rev-parse", "--show-toplevel")).resolve() != checkout:  # installed into somebody else's
            return hydroviews.__version__
        commit = git("describe", "--always", "--exclude=*")
        paths = [*CODE, *(f":(exclude){name}" for name in NO_CODE)]
        changed = git("--no-optional-locks", "status", "--porcelain", "--", *paths)
    except (OSError, subprocess.CalledProcessError):
        return hydroviews.__version__
    return f"{hydroviews.__version__}+{commit}" + ("-dirty" if changed else "")
