"""A sweep: what is missing of a matrix is built and run, and the tables are written."""

import logging
from dataclasses import dataclass
from pathlib import Path

from hydroviews.errors import InputError
from hydroviews.files.ownership import require_ours
from leaderboard.gather import run_folders, trusted_record, write_leaderboard
from leaderboard.records import FAILED
from leaderboard.runs.run import Run
from leaderboard.runs.run_options import MethodName, RunOptions
from leaderboard.runs.supervision import Limits
from leaderboard.sweep.local import fitting_workers, log_path, run_here
from leaderboard.sweep.matrix import Matrix, build_runs, is_finished, matrix_of, read_matrix
from leaderboard.sweep.ray_cluster import run_on_ray
from leaderboard.sweep.slurm import write_slurm

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class SweepRequest(RunOptions):
    """The runs of a sweep, and where they run."""

    matrix: Path | None = None  # TOML file with methods, scenes, patterns, seeds, profile and track
    methods: tuple[MethodName, ...] = ()
    scenes: tuple[str, ...] = ("courtyard",)
    seeds: tuple[int, ...] = (0,)
    workers: int | None = None  # runs at a time on this machine. Default: as many as cores and memory allow
    threads: int = 1  # cores per run
    slurm: Path | None = None  # write the script of a Slurm array to this file, and run nothing
    ray: str | None = None  # address of a Ray cluster, in place of this machine
    gpus: float = 0  # GPUs per run on a Ray cluster


def sweep(request: SweepRequest) -> dict[Run, str]:
    """Build what is missing, carry out the runs that are not done, write the tables.

    Returns:
        Why runs have failed, for those that have.

    Raises:
        InputError: something the user can mend.
    """
    limits = request.limits
    _check(request)
    runs = build_runs(_matrix(request), request.data, request.results, request.captures)
    missing = [run for run in runs if not is_finished(run)]
    logger.info("%d runs, %d of them done", len(runs), len(runs) - len(missing))
    if request.slurm:
        if missing:
            write_slurm(request.slurm, missing, limits, request.threads)
            logger.info("%s: %d tasks; start them with sbatch", request.slurm, len(missing))
        return {}
    try:
        failures = _carry_out(request, missing, limits) if missing else {}
    finally:  # whatever ended stands in the table, also if the rest was interrupted
        if run_folders(request.results):
            write_leaderboard(request.results)
    return failures | _failed(missing, failures)


def _carry_out(request: SweepRequest, runs: list[Run], limits: Limits) -> dict[Run, str]:
    if request.ray:
        return run_on_ray(request.ray, runs, limits, request.threads, request.gpus)
    workers = request.workers or fitting_workers(request.threads, limits.memory)
    return run_here(runs, limits, workers, request.threads)


def _failed(runs: list[Run], without_record: dict[Run, str]) -> dict[Run, str]:
    records = {run: trusted_record(run.folder) for run in runs if run not in without_record}
    return {run: f"{record.reason}{_printed(run)}" for run, record in records.items() if record.status == FAILED}


def _printed(run: Run) -> str:
    """Where to read what a run printed; empty for one that has no log here, as on a Ray cluster."""
    return f" (what it printed: {log_path(run)})" if log_path(run).is_file() else ""


def _matrix(request: SweepRequest) -> Matrix:
    names = ("methods", "scenes", "patterns", "seeds", "profile", "track")
    given = {name: getattr(request, name) for name in names}
    if request.matrix is None:
        return matrix_of(given, "options")
    default = SweepRequest()
    both = [f"--{name}" for name in names if given[name] != getattr(default, name)]
    if both:
        raise InputError(f"--matrix {request.matrix}: given with {' '.join(both)}", expected="a file or options")
    return read_matrix(request.matrix)


def _check(request: SweepRequest) -> None:
    if request.slurm and request.ray:
        raise InputError("--slurm and --ray: both given", expected="one of them, or neither")
    if request.threads < 1 or (request.workers is not None and request.workers < 1):
        raise InputError(f"--workers {request.workers} --threads {request.threads}", expected="1 or more of each")
    if request.gpus < 0:
        raise InputError(f"--gpus {request.gpus:g}: negative", expected="0 or more")
    require_ours([request.slurm] if request.slurm else [])
