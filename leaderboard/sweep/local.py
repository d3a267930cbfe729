"""The runs of a sweep on this machine: so many at a time, each on cores of its own."""

import os
import queue
import tempfile
import threading
from collections.abc import Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path

from tqdm import tqdm

from hydroviews.cli.processes import held_signals
from hydroviews.cli.threads import cores
from hydroviews.errors import InputError
from leaderboard.runs.run import Run
from leaderboard.runs.supervision import GB, WORKERS, Limits, end_gently, run_tethered
from leaderboard.sweep.one import options

LOGS = "logs"  # in the results folder: what each run prints
MEMORY = 4.0  # 10^9 bytes that a run without a limit is taken to need; in the demo profile none has had 1


@dataclass
class Stop:
    """Ends all workers' runs once the sweep has been interrupted."""

    event: threading.Event
    reason: str = ""

    def overdue(self) -> bool:
        """Whether it has."""
        if self.event.is_set():
            self.reason = "interrupted"
        return bool(self.reason)


def available_memory() -> float:
    """Memory that may be had without swapping, in 10^9 bytes; all there is where the system does not say."""
    meminfo = Path("/proc/meminfo")
    if meminfo.is_file():
        for line in meminfo.read_text().splitlines():
            if line.startswith("MemAvailable:"):
                return int(line.split()[1]) * 1024 / GB
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / GB


def fitting_workers(threads: int, memory: float | None) -> int:
    """As many runs at a time as cores and memory allow, 1 at least.

    Args:
        threads: of each run.
        memory: 10^9 bytes of each run; MEMORY if not given.
    """
    return max(1, min(len(cores()) // threads, int(available_memory() / (memory or MEMORY))))


def run_environment(threads: int, workers: int | None = None) -> dict[str, str]:
    """Environment variables of a run.

    Args:
        threads: that each of its libraries keeps to.
        workers: runs at a time on its machine; None on a cluster, where what else a node does is not known.
    """
    names = ("OMP", "NUMBA", "MKL", "OPENBLAS")
    return {f"{name}_NUM_THREADS": str(threads) for name in names} | {WORKERS: str(workers or "")}


def run_here(runs: Sequence[Run], limits: Limits, workers: int, threads: int) -> dict[Run, str]:
    """Carry out runs, so many at a time.

    Returns:
        Why a run has not come to a record, for those that have not.

    Raises:
        InputError: there are fewer cores than threads of all workers.
        KeyboardInterrupt, SystemExit: interrupted; all runs have saved and stopped.
    """
    free = cores()
    if workers * threads > len(free):
        raise InputError(
            f"--workers {workers} --threads {threads}: more than there are cores",
            found=f"{len(free)} cores",
            expected="a core of its own for every thread",
        )
    workers = min(workers, len(runs))
    slots: queue.SimpleQueue[list[int]] = queue.SimpleQueue()
    for i in range(workers):  # one alone has no need of cores of its own, and another sweep may be on them
        slots.put(free[i * threads : (i + 1) * threads] if workers > 1 else free)
    environment = {**os.environ, **run_environment(threads, workers)}
    stop = threading.Event()
    failures: dict[Run, str] = {}
    pool = ThreadPoolExecutor(workers, initializer=lambda: _stay_on(slots.get()))
    try:
        futures = {pool.submit(_run, run, limits, environment, stop): run for run in runs}
        for future in tqdm(as_completed(futures), desc="sweep", unit="run", total=len(runs)):
            if reason := _reason(future):
                failures[futures[future]] = reason
    finally:
        stop.set()
        with held_signals():
            pool.shutdown(cancel_futures=True)
    return failures


def _stay_on(own: Sequence[int]) -> None:
    """Keep this thread, and with it the processes that it starts, to these cores."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, own)


def _run(run: Run, limits: Limits, environment: Mapping[str, str], stop: threading.Event) -> str:
    """The process of one run, whose words go into a file; why it came to nothing, or ""."""
    log = log_path(run)
    log.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="hydroviews-sweep-") as notes, log.open("ab") as output:
        return run_tethered(
            "leaderboard.sweep.one",
            options(run, limits),
            Path(notes),
            Stop(stop),
            end_gently,
            output=output,
            environment=environment,
        )


def log_path(run: Run) -> Path:
    """The file that takes what a run of a sweep prints."""
    return run.results / LOGS / f"{'-'.join(run.folder.relative_to(run.results).parts)}.log"


def _reason(future: "Future[str]") -> str:
    try:
        return future.result()
    except InputError as error:  # this run's: the others go on
        return str(error)
