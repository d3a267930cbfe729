"""A run as the pages show it: its record, the command that repeats it, its files."""

import re
import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any
from urllib.parse import quote, urlsplit

import pandas as pd

from hydroviews.dataset.clean_views import CLEAN
from hydroviews.dataset.suites import suite_of
from hydroviews.formats.capture_json import CAPTURED
from leaderboard.records import PLACE, run_folder
from leaderboard.tables.dataframes import grade_of
from leaderboard.tables.means import shown_names

OTHER = "other"  # the suite of a scene that is in none


@dataclass(frozen=True)
class ShownRun:
    """A run of a results folder."""

    record: Mapping[str, Any]  # by column; None where there is nothing
    name: str  # of the method, as tables have it
    suite: str
    grade: str
    folder: Path
    page: str  # name of its page's file
    command: str  # that repeats it; empty for what was submitted
    files: tuple[tuple[str, str], ...]  # name, and address as seen from its page
    link: str  # to what a submitter did; only an address of the web


def shown_runs(table: pd.DataFrame, results: Path) -> list[ShownRun]:
    """The runs of a table, in its order."""
    named = table.assign(shown=shown_names(table)).astype(object)
    rows = named.where(named.notna(), None).to_dict("records")
    return [_shown({str(name): value for name, value in row.items()}, results) for row in rows]


def _shown(row: dict[str, Any], results: Path) -> ShownRun:
    name = row.pop("shown")
    folder = run_folder(results, *(row[key] for key in PLACE))
    return ShownRun(
        row,
        name,
        suite_of(row["scene"]) or OTHER,
        grade_of(row["pattern"]),
        folder,
        page_name(*(str(row[key]) for key in PLACE)),
        "" if row["submitted_by"] else _command(row),
        _files(folder, results),
        _web_address(row["link"] or ""),
    )


def _web_address(link: str) -> str:
    """The link, if it leads to the web; records of before may hold any text."""
    try:
        parts = urlsplit(link)
    except ValueError:
        return ""
    return link if parts.scheme in ("http", "https") and parts.hostname else ""


def page_name(*names: str) -> str:
    """A file name that any disk and web server takes, another one for other names."""
    plain = re.sub(r"[^A-Za-z0-9]+", "-", "-".join(names)).strip("-").lower()[:80]
    return f"{plain}-{sha256(repr(names).encode()).hexdigest()[:8]}.html"


def _command(row: Mapping[str, Any]) -> str:
    options = {"scene": row["scene"]}
    if row["pattern"] not in (CLEAN, CAPTURED):
        options["patterns"] = row["pattern"]
    options |= {name: str(row[name]) for name in ("profile", "seed", "track")}
    return shlex.join(["hydroviews", "eval", row["method"], *(w for k, v in options.items() for w in (f"--{k}", v))])


def _files(folder: Path, results: Path) -> tuple[tuple[str, str], ...]:
    below = "/".join(["..", "..", *folder.relative_to(results).parts])
    try:
        names = sorted(f"{path.name}{'/' if path.is_dir() else ''}" for path in folder.iterdir() if path.name[0] != ".")
    except FileNotFoundError:  # removed since its record was read
        names = []
    return tuple((name, quote(f"{below}/{name}")) for name in names)
