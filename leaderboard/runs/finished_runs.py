"""Finished runs, opened again by their folder: to look at them, to film them, to export their Gaussians."""

import logging
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from baselines.method import Method, find_method
from baselines.splatting.files.ply import SPLATS, read_ply
from baselines.splatting.gaussians import Gaussians
from hydroviews.errors import InputError
from hydroviews.files.atomic import read_json
from leaderboard.records import LEADERBOARD, LEVELS, PLACE, results_above
from leaderboard.runs.own_files import PREDICTION
from leaderboard.runs.run import CONFIG, Run, refuse_other_data

logger = logging.getLogger(__name__)

LISTED = 12  # runs that an error names


@dataclass(frozen=True, kw_only=True)
class MovedRun(Run):
    """A run whose folder was moved or copied out of its results folder."""

    place: Path

    @property
    def folder(self) -> Path:
        """Where its files are."""
        return self.place


def open_run(folder: Path, data: Path) -> Run:
    """The run that a folder holds, by its `config.json`, wherever it lies, with the data it was trained on.

    Args:
        folder: such as results/demo/3dgs/courtyard/raindrop-1/seed-0.
        data: the folder that `make eval` built in.

    Raises:
        InputError: no finished run, or other data than it was trained on.
    """
    require_finished(folder)
    place, settings = folder.resolve(), _settings(folder / CONFIG)
    names = {name: settings[name] for name in PLACE}
    run = Run(data=data / settings["profile"], results=results_above(place), **names)
    if run.folder != place:
        run = MovedRun(data=run.data, results=run.results, **names, place=place)
    refuse_other_data(run, "name the folder that it was built in with --data (make: DATA=), or evaluate the run anew")
    return run


def _settings(path: Path) -> dict[str, Any]:
    """The settings of a run, with all that names it.

    Raises:
        InputError: they are not those of a run.
    """
    settings = read_json(path)
    kinds = {name: int if name == "seed" else str for name in PLACE}
    found = settings if isinstance(settings, dict) else {}
    odd = [name for name, kind in kinds.items() if type(found.get(name)) is not kind]
    if odd:
        raise InputError(
            f"{path}: not the settings of a run",
            found=f"no {', '.join(odd)}",
            fix="restore the file, or evaluate the run anew",
        )
    return found


def require_finished(folder: Path) -> None:
    """Refuse a folder without a trained model and its renders.

    Raises:
        InputError: there is none; it names the finished runs there are.
    """
    if (folder / CONFIG).is_file() and (folder / PREDICTION).is_file():
        return
    runs = finished_runs(folder)
    listed = "".join(f"\n    {run}" for run in runs[:LISTED])
    more = f"\n    and {len(runs) - LISTED} more" if len(runs) > LISTED else ""
    raise InputError(
        f"{folder}: " + ("training has not finished" if (folder / CONFIG).is_file() else "no such run"),
        expected=f"one of{listed}{more}"
        if runs
        else "the folder of a finished run, such as results/demo/3dgs/courtyard/raindrop-1/seed-0",
        fix="give the folder of a finished run; make eval METHOD=3dgs makes some, or goes on with them",
    )


def finished_runs(folder: Path) -> list[Path]:
    """Finished runs of the results folder that `folder` lies in or is, nearest first; of `results` if in none."""
    above = (parent for parent in (folder, *folder.parents) if (parent / LEADERBOARD).is_file())
    results = next(above, Path("results"))
    runs = sorted(path.parent for path in results.glob("*/" * LEVELS + PREDICTION))
    return sorted(runs, key=lambda run: -len(os.path.commonpath([run.absolute(), folder.absolute()])))


def load_method(run: Run) -> Method:
    """The trained model; says so where the method's settings are no longer those of the run.

    Raises:
        InputError: no such method, or no model that it can read.
    """
    method = find_method(run.method)
    trained, now = read_json(run.folder / CONFIG)["config"], run.settings()["config"]
    if now != trained:
        changed = [name for name in sorted({*now, *trained}) if now.get(name) != trained.get(name)]
        logger.info("%s: since it was trained, %s has other settings: %s", run, run.method, ", ".join(changed))
    return method.load(method.configuration(run.profile), run.seed, run.folder)


def find_splats(folder: Path) -> Gaussians | None:
    """The Gaussians of a run, None where its method has none."""
    path = folder / SPLATS
    return read_ply(path) if path.is_file() else None
