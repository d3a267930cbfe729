"""A sweep on a Ray cluster whose nodes share a disk: one task a run. Ray places, retries and counts."""

import socket
from collections.abc import Sequence
from dataclasses import replace
from typing import Any
from urllib.parse import urlsplit

from tqdm import tqdm

from hydroviews.errors import InputError
from leaderboard.evaluate import carry_out
from leaderboard.runs.run import Run
from leaderboard.runs.supervision import GB, Limits
from leaderboard.sweep.local import MEMORY, run_environment

PATIENCE = 5.0  # seconds that an address has to answer
RETRIES = 3  # of a task whose node or process was lost


def run_on_ray(address: str, runs: Sequence[Run], limits: Limits, threads: int, gpus: float) -> dict[Run, str]:
    """Carry out runs as tasks of a Ray cluster.

    Args:
        address: such as 10.0.0.1:6379, ray://10.0.0.1:10001, or auto for a cluster that this machine belongs to.
        runs: their data and results are on a disk that all nodes have at the same place.
        limits: of each run.
        threads: cores of each run.
        gpus: of each run; a share is allowed.

    Returns:
        Why a run has not come to a record, for those that have not.

    Raises:
        InputError: Ray is not installed, or nothing answers.
    """
    ray = _connected(address, threads)
    try:
        return _collected(ray, _submitted(ray, runs, limits, threads, gpus))
    finally:
        ray.shutdown()  # ends what is still at work


def _connected(address: str, threads: int) -> Any:
    """The module of Ray, connected to a cluster."""
    try:
        import ray
    except ImportError:
        raise InputError(f"--ray {address}: Ray is not installed", fix="pip install ray, on all nodes") from None
    _require_answer(address)
    try:
        ray.init(address=address, log_to_driver=False, runtime_env={"env_vars": run_environment(threads)})
    except (ConnectionError, RuntimeError, ValueError) as error:
        raise _no_answer(address, error) from None
    return ray


def _submitted(ray: Any, runs: Sequence[Run], limits: Limits, threads: int, gpus: float) -> dict[Any, Run]:
    """Give the cluster a task a run; the runs by what Ray knows their tasks by."""
    task = ray.remote(
        num_cpus=threads,
        num_gpus=gpus,
        memory=int((limits.memory or MEMORY) * GB),
        max_retries=RETRIES,
        max_calls=1,  # the memory of a run goes with its process
    )(_task)
    return {task.remote(_elsewhere(run), limits): run for run in runs}


def _collected(ray: Any, waiting: dict[Any, Run]) -> dict[Run, str]:
    """Wait for all tasks; why runs have not come to a record."""
    failures = {}
    with tqdm(desc="sweep", unit="run", total=len(waiting)) as bar:
        while waiting:
            (ready,), _ = ray.wait(list(waiting), num_returns=1)
            run = waiting.pop(ready)
            try:
                reason = ray.get(ready)
            except ray.exceptions.RayError as error:
                reason = f"lost by Ray: {str(error).splitlines()[0]}"
            if reason:
                failures[run] = reason
            bar.update()
    return failures


def _task(run: Run, limits: Limits) -> str:
    try:
        carry_out(run, limits)
    except InputError as error:
        return str(error)
    return ""


def _elsewhere(run: Run) -> Run:
    """The run with paths that hold in any working directory."""
    return replace(run, data=run.data.absolute(), results=run.results.absolute())


def _require_answer(address: str) -> None:
    """Ask before Ray does, which waits for minutes and then ends the process."""
    if address == "auto":
        return
    try:
        place = urlsplit(address if "://" in address else f"ray://{address}")
        if not place.hostname or not place.port:
            raise ValueError("no HOST:PORT")
        socket.create_connection((place.hostname, place.port), PATIENCE).close()
    except (OSError, ValueError) as error:
        raise _no_answer(address, error) from None


def _no_answer(address: str, error: Exception) -> InputError:
    return InputError(
        f"--ray {address}: no Ray cluster answers",
        found=str(error).splitlines()[0] if str(error) else type(error).__name__,
        expected="HOST:PORT of a head node, ray://HOST:PORT, or auto",
        fix="start one with `ray start --head`",
    )
