"""All records of a results folder as one table, in which an odd one is a row with a reason."""

import csv
import logging
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import pandas as pd

from hydroviews.dataset.suites import suite_of
from hydroviews.errors import InputError
from hydroviews.files.atomic import as_file, read_json
from hydroviews.files.full_disk import ReadOnly
from hydroviews.files.locks import BUSY, locked
from hydroviews.files.temporary import remove_leftovers_in
from hydroviews.formats.tables.csv_tables import read_csv, write_csv
from hydroviews.metrics import find_metrics
from leaderboard.records import (
    GIVEN_POSES,
    LEADERBOARD,
    LEVELS,
    PER_VIEW,
    PLACE,
    RECORD,
    RESCORE,
    SCORED,
    TRACKS,
    UNREADABLE,
    Record,
    as_row,
    columns,
    effect_of,
    read_record,
    results_above,
    run_folder,
)
from leaderboard.tables.table_files import write_tables

logger = logging.getLogger(__name__)

BOARD = Path(__file__).with_name("board")  # the runs that ship: `publish` alone writes there
PUBLICATION = "published.json"  # on a board
LAST = re.compile(rf"seed-[0-9]{{1,9}}(-({'|'.join(TRACKS)}))?")  # folder of a seed, with its track
COUNTS = ("n_train", "n_test", "width", "height", "n_primitives", "workers", "sessions", "photographs", "registered")
VIEW_KEYS = (
    "method", "submitted_by", "profile", "track", "suite", "scene", "effect", "pattern", "seed", "data_sha256"
)  # fmt: skip
ROUNDED = 1e-5  # what a score of a record may differ from the mean of its views: it is rounded to five digits


def collect(results: Path) -> pd.DataFrame:
    """All records of a results folder, one row each, in the order of `columns`.

    A record that cannot be used is a row too: with the names of its folder, status unreadable, the reason, and
    without numbers. Only where the folder is none of a run's, such as a copy kept beside it, there is just a warning.
    """
    rows = []
    for folder in run_folders(results):
        try:
            rows.append(as_row(trusted_record(folder)))
        except InputError as error:
            logger.warning("not counted: %s", error)
            if LAST.fullmatch(folder.name):
                rows.append(as_row(_unreadable(folder, str(error))))
    table = pd.DataFrame(rows, columns=columns()).astype(dict.fromkeys(COUNTS, "Int64"))  # whole, where one is missing
    return table.sort_values(["profile", "scene", "track", "effect", "pattern", "method", "seed"], ignore_index=True)


def collect_views(table: pd.DataFrame, results: Path) -> pd.DataFrame:
    """The scores of every view of every scored run of a table, tidy: a row a view, in the order of the table.

    A run that was removed since is left out with a warning.

    Returns:
        Columns VIEW_KEYS, `view`, and one a metric.
    """
    metrics = [metric.name for metric in find_metrics()]
    parts = []
    for run in table[table.status.isin(SCORED) & table[metrics].notna().any(axis=1)].to_dict("records"):
        folder = run_folder(results, *(run[name] for name in PLACE))
        try:
            views = read_csv(folder / PER_VIEW, texts=["view"])
        except FileNotFoundError:  # other processes may be at work here
            logger.warning("%s: its views are not counted: removed since its record was read", folder)
            continue
        keys = {name: run[name] for name in VIEW_KEYS if name != "suite"} | {"suite": suite_of(run["scene"])}
        parts.append(views.assign(**keys))
    found = pd.concat(parts, ignore_index=True) if parts else pd.DataFrame()
    return found.reindex(columns=[*VIEW_KEYS, "view", *metrics])


def run_folders(results: Path) -> list[Path]:
    """The folders in a results folder that hold a record, sorted."""
    return [path.parent for path in sorted(results.glob("*/" * LEVELS + RECORD))]


def trusted_record(folder: Path) -> Record:
    """The record of a run, if it belongs there and its scores are those of its views.

    Raises:
        InputError: there is none or an odd one, it is another run's, or `per_view.csv` says otherwise.
    """
    record = read_record(folder / RECORD)
    belongs = run_folder(results_above(folder), *(getattr(record, name) for name in PLACE))
    if belongs != folder:
        raise InputError(
            f"{folder / RECORD}: the record of another run", found=belongs, fix="move the run back, or remove it"
        )
    if record.scores:
        _check_scores(folder / PER_VIEW, record)
    return record


def _check_scores(path: Path, record: Record) -> None:
    """Refuse scores that are not the means of what `per_view.csv` holds.

    Raises:
        InputError: they differ, or there is no such file.
    """
    try:
        with as_file(path).open(newline="") as file:
            views = list(csv.DictReader(file))
        means = {name: math.fsum(float(view[name]) for view in views) / len(views) for name in record.scores}
    except (OSError, ValueError, KeyError, TypeError, ZeroDivisionError, csv.Error) as error:
        raise InputError(f"{path}: does not hold the record's scores", found=repr(error), fix=RESCORE) from None
    differ = [name for name, value in record.scores.items() if not abs(means[name] - value) <= ROUNDED]
    if differ or len(views) != record.n_test:
        raise InputError(
            f"{path.with_name(RECORD)}: its scores are not those of its views",
            found=_in_words(record.scores, differ, record.n_test),
            expected=_in_words(means, differ, len(views)),
            fix=RESCORE,
        )


def _in_words(scores: Mapping[str, float], names: Sequence[str], n_views: int | None) -> str:
    return ", ".join([*(f"{name} {scores[name]:.5g}" for name in names), f"{n_views} views"])


def _unreadable(folder: Path, reason: str) -> Record:
    """A row for a run whose record cannot be used, with the names of its folder."""
    profile, method, scene, pattern, last = folder.parts[-LEVELS:]
    seed, _, track = last.removeprefix("seed-").partition("-")
    return Record(
        method=method,
        scene=scene,
        effect=effect_of(pattern),
        pattern=pattern,
        seed=int(seed),
        track=track or GIVEN_POSES,
        status=UNREADABLE,
        reason=reason,
        n_train=None,
        n_test=None,
        width=None,
        height=None,
        profile=profile,
    )


def read_leaderboard(results: Path) -> pd.DataFrame:
    """All records, as `collect` has them; nothing is written.

    Raises:
        InputError: there is no record.
    """
    table = collect(results)
    if table.empty:
        raise InputError(f"{results}: no finished run", fix="run `make eval METHOD=3dgs` first")
    return table


def write_leaderboard(results: Path) -> pd.DataFrame:
    """Gather every record into `leaderboard.csv`, `per_view.csv` and the tables; what is missing stays empty.

    Records are read and the files written under one lock, so that of two evaluations that end together the later one
    has the rows of both. Where nothing may be written there is a warning: the table is there to be printed. Nothing is
    written into BOARD.

    Raises:
        InputError: there is no record.
    """
    if is_board(results) or not results.is_dir():
        return read_leaderboard(results)
    with locked(results / LEADERBOARD, BUSY):
        table = read_leaderboard(results)
        try:
            remove_leftovers_in(results)
            write_csv(results / LEADERBOARD, table)
            write_csv(results / PER_VIEW, collect_views(table, results))
            write_tables(table, results)
        except ReadOnly as error:
            logger.warning("%s", error)
    return table


def publication(board: Path) -> dict[str, str]:
    """When (`date`) and with which `version` of the code the last runs came onto a board; empty for other results.

    Raises:
        InputError: the note is damaged.
    """
    path = board / PUBLICATION
    if not path.is_file():
        return {}
    note = read_json(path)
    if not (isinstance(note, dict) and {"date", "version"} <= note.keys()):
        raise InputError(
            f"{path}: not a note of `leaderboard publish`", expected="date and version", fix="remove the file"
        )
    return {name: str(note[name]) for name in ("date", "version")}


def is_board(results: Path) -> bool:
    """Whether a folder is the board that ships."""
    return results.resolve() == BOARD.resolve()
