"""All scores of a results folder calculated again from the stored renders, and compared with what is recorded."""

import logging
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hydroviews.errors import InputError
from hydroviews.formats.csv_tables import read_csv
from hydroviews.metrics import find_metrics
from leaderboard.gather import ROUNDED, run_folders, trusted_record
from leaderboard.records import PER_VIEW, SCORED, Record
from leaderboard.runs.finished_runs import open_run
from leaderboard.runs.run import Run
from leaderboard.scoring.score import calculate, renders, renders_sha256

logger = logging.getLogger(__name__)

TOLERANCE = 1e-6  # what a score may differ by
MEAN = "mean"  # stands for a view's name


@dataclass(frozen=True)
class Difference:
    """A number that is recorded and comes out otherwise, or is only on one side."""

    run: str
    view: str  # its name, or MEAN
    metric: str
    recorded: float | None
    now: float | None


@dataclass(frozen=True)
class Rescored:
    """What `rescore` has found."""

    runs: int  # that were calculated again
    differences: Sequence[Difference]
    not_compared: Mapping[Path, str]  # runs with scores that cannot be calculated again, and why

    @property
    def agrees(self) -> bool:
        """Whether everything that is recorded comes out again."""
        return not self.differences and not self.not_compared


def rescore(results: Path, data: Path) -> Rescored:
    """Calculate every metric of every scored run again from its renders; nothing is written.

    Args:
        results: the folder of the runs.
        data: the folder that they were built in.

    Raises:
        InputError: there is no run.
    """
    folders = run_folders(results)
    if not folders:
        raise InputError(f"{results}: no finished run", fix="name the folder with --results")
    runs, differences, not_compared = 0, [], {}
    for folder in folders:
        try:
            record = trusted_record(folder)
            if record.status in SCORED and record.scores:
                run = open_run(folder, data)
                logger.info("%s", run)
                differences += list(_differences(run, record))
                runs += 1
        except InputError as error:
            not_compared[folder] = str(error)
    return Rescored(runs, differences, not_compared)


def _differences(run: Run, record: Record) -> Iterator[Difference]:
    """Of a run's scores, a view and the means."""
    clean = run.clean_scene()
    rows, scores, _ = calculate(run, clean)
    views = read_csv(run.folder / PER_VIEW, texts=["view"]).set_index("view").to_dict("index")
    if record.renders_sha256 not in ("", renders_sha256(renders(run, clean))):
        logger.warning("%s: its renders are not those that were scored", run)
    for row in rows:
        yield from _unlike(run, row["view"], views.get(row["view"], {}), row, TOLERANCE)
    yield from _unlike(run, MEAN, record.scores, scores, TOLERANCE + ROUNDED)


def _unlike(
    run: Run, view: str, recorded: Mapping[Any, Any], now: Mapping[str, Any], tolerance: float
) -> Iterator[Difference]:
    for metric in find_metrics():
        before, after = _number(recorded.get(metric.name)), _number(now.get(metric.name))
        if before != after and (before is None or after is None or not abs(before - after) <= tolerance):
            yield Difference(str(run), view, metric.name, before, after)


def _number(value: Any) -> float | None:
    return None if value is None or math.isnan(value) else float(value)
