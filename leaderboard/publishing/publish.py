"""Runs copied onto the board that ships: what was measured, with a few small pictures, without models.

A run of a board is its `record.json`, `per_view.csv`, learning curve and `small_pictures`, in the folders of a results
folder, so that whatever reads results reads a board. Failed runs are published too, without scores: a table that lacks
them flatters a method.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any

from baselines.training.learning_curve import LEARNING_CURVE
from hydroviews.errors import InputError
from hydroviews.files import ownership
from hydroviews.files.atomic import read_json, write_bytes, write_json
from hydroviews.files.temporary import remove_leftovers
from leaderboard.gather import PUBLICATION, publication, run_folders, trusted_record
from leaderboard.publishing.small_pictures import ship_views, shipped_renders
from leaderboard.records import (
    DONE,
    FAILED,
    FIELDS,
    PER_VIEW,
    RECORD,
    RESCORE,
    SCHEMA,
    Record,
    code_version,
    read_record,
)
from leaderboard.runs.own_files import RENDERS
from leaderboard.site.pictures import SMALL, small_copy

PUBLISHED = (RECORD, PER_VIEW, LEARNING_CURVE)  # a failed run has no scores, a submission no training


@dataclass(frozen=True)
class Outcome:
    """What `publish` did; runs are named by their folders below results and board."""

    written: tuple[Path, ...]
    kept: int  # are on the board already
    left_out: Mapping[Path, str]  # runs that are partial or cannot be trusted, and why


@dataclass(frozen=True)
class _Run:
    record: Record
    schema: int
    files: Mapping[str, bytes]
    pictures: Mapping[str, Path]  # what small ones are made of, by their names


def publish(
    results: Path,
    board: Path,
    submitted: bool = False,
    overwrite: bool = False,
    day: date | None = None,
    data: Path | None = None,
) -> Outcome:
    """Copy the records and views' scores of all trusted runs, done or failed. A run is there whole or not at all.

    Args:
        results: folder of the runs.
        board: takes them.
        submitted: those that somebody submitted as well.
        overwrite: replace runs that are on the board and are others; files of somebody else's in their folders stay.
        day: on which runs are published, noted on the board with the version of the code; None: what `results` notes.
        data: folder of the data sets, for pictures of the views that runs were given; None: those that `results` has.

    Raises:
        InputError: no such run; or one that does not belong on a board: of a changed checkout, another schema or other
            data, submitted, or already there. It names them all, and nothing is written.
    """
    runs, left_out = _read(results)
    remove_leftovers(board)
    there = {folder.relative_to(board) for folder in run_folders(board)}
    new = {name: run for name, run in runs.items() if name not in there or _differs(board / name, run)}
    faults = [fault for name, run in new.items() for fault in _faults(name, run, submitted)]
    if not overwrite:
        faults += [
            f"{name}: on the board, as another run; --overwrite replaces it" for name in sorted(new.keys() & there)
        ]
    kept = {name: trusted_record(board / name) for name in sorted(there - new.keys())}
    faults += _unlike_data(kept | {name: run.record for name, run in new.items()})
    if faults:
        raise InputError(f"{results}: not published\n" + "\n".join(f"    {fault}" for fault in faults))
    if not runs:
        raise InputError(
            f"{results}: no run that is done or failed", fix="evaluate some, or name another folder with --results"
        )
    if new:
        ownership.claim(board)
    for name, run in new.items():
        _write_run(board / name, {**run.files, **{file: small_copy(path) for file, path in run.pictures.items()}})
    ship_views({name: run.record for name, run in new.items()}, results, data, board)
    note = {"date": day.isoformat(), "version": code_version()} if day else publication(results)
    if note and (new or not day) and note != publication(board):
        ownership.remove(board / PUBLICATION, [board / PUBLICATION])  # ours; a copy of the repository has no list
        write_json(board / PUBLICATION, note)
    return Outcome(tuple(new), len(runs) - len(new), left_out)


def _read(results: Path) -> tuple[dict[Path, _Run], dict[Path, str]]:
    """The runs to publish, and why others are not."""
    runs, left_out = {}, {}
    for folder in run_folders(results):
        name = folder.relative_to(results)
        try:
            record = trusted_record(folder)
        except InputError as error:
            left_out[name] = str(error)
            continue
        written = read_json(folder / RECORD, RESCORE)
        if _is_whole(record, written):
            files = {file: (folder / file).read_bytes() for file in PUBLISHED if (folder / file).is_file()}
            pictures = shipped_renders(folder, record.scene) if record.status == DONE else {}
            runs[name] = _Run(record, written.get("schema", 1), files, pictures)
        else:
            left_out[name] = f"{record.status}: {record.reason}".removesuffix(": ")
    return runs, left_out


def _is_whole(record: Record, written: Mapping[str, Any]) -> bool:
    """Whether a run is failed, or done by the metrics that it was scored with: others may be registered since."""
    lacking = [name for name, value in written.items() if value is None and name not in FIELDS]
    return record.status in (DONE, FAILED) or (written["status"] == DONE and not lacking)


def _differs(folder: Path, run: _Run) -> bool:
    """True if a run on a board is another one, or lacks pictures. Pictures are not compared: encoders differ."""
    if any(not (folder / name).is_file() for name in run.pictures):
        return True
    return any(not (folder / name).is_file() or (folder / name).read_bytes() != run.files[name] for name in run.files)


def _faults(name: Path, run: _Run, submitted: bool) -> Iterator[str]:
    """Why a run does not belong on a board."""
    if "-dirty" in run.record.version:
        yield f"{name}: of a changed checkout, version {run.record.version}; evaluate it with code that is committed"
    if run.schema != SCHEMA:
        yield f"{name}: record of schema {run.schema}, expected {SCHEMA}; leaderboard score writes it anew"
    if run.record.submitted_by and not submitted:
        yield f"{name}: submitted by {run.record.submitted_by}; --submitted takes it"


def _unlike_data(records: Mapping[Path, Record]) -> list[str]:
    """The variants of scenes that runs of a board would have other data for."""
    found: dict[tuple[str, str, str], dict[str, list[str]]] = {}
    for name, record in records.items():
        data = found.setdefault((record.profile, record.scene, record.pattern), {})
        data.setdefault(record.data_sha256, []).append(str(name))
    return [
        f"{'/'.join(variant)}: runs on other data: "
        + "; ".join(f"{sha256[:12]} {runs[0]}" for sha256, runs in data.items())
        for variant, data in found.items()
        if len(data) > 1
    ]


def _write_run(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write a run; its record goes first and comes last, since a folder without a record is no run."""
    known = _of_a_run(folder)
    for name in [*PUBLISHED, *_pictures(folder)]:
        ownership.remove(folder / name, known)
    for name in sorted(files, key=lambda name: name == RECORD):
        write_bytes(folder / name, files[name])


def _of_a_run(folder: Path) -> list[Path]:
    """The files of a run that no list has, as in a copy of the repository; none where the record is no record."""
    try:
        read_record(folder / RECORD)
    except InputError:
        return []
    return [folder / name for name in [*PUBLISHED, *_pictures(folder)]]


def _pictures(folder: Path) -> list[str]:
    return [f"{RENDERS}/{path.name}" for path in sorted((folder / RENDERS).glob(f"*{SMALL}"))]
