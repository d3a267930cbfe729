"""Training steps beside other processes that want the cores: steps a second, and the share of what is fair.

    python -m benchmarks.busy_machine

Every case is a process of its own, beside so many that do nothing but count. Fair is what a training would do if the
system gave every thread as much: of the steps that it does on an idle machine, with as many threads, the share
cores / (threads + competing). Prints a table and writes `busy_machine.csv`. The machine has to be idle before.
"""

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pandas as pd
from tqdm import tqdm

from baselines.splatting.backends.base import CpuBackend
from baselines.splatting.backends.warm_up import warm_up
from baselines.splatting.objective import Objective
from baselines.splatting.state import fresh_state
from baselines.training.checkpoints import CHECKPOINT, Tree
from baselines.training.loop import run
from benchmarks.splatting.scenes import picture, room, view
from benchmarks.splatting.speed import still
from hydroviews.cli.commands import run_command
from hydroviews.cli.threads import processors
from hydroviews.files.atomic import write_bytes

BUSY = "while True: pass"
GAUSSIANS, SIZE = 30_000, (400, 300)


def fair_share(steps: float, idle: float, threads: int, competing: int, cores: int) -> float:
    """How much of its fair share a training gets, 1 for all.

    Args:
        steps: a second.
        idle: the same, with as many threads, on an idle machine.
        threads: of the training.
        competing: threads of others that are never idle.
        cores: for all of them.
    """
    return steps / (idle * min(1.0, cores / (threads + competing)))


@contextmanager
def busy(count: int) -> Iterator[None]:
    """So many processes that do nothing but count, while the block lasts."""
    with ExitStack() as stack:
        for _ in range(count):
            process = stack.enter_context(subprocess.Popen([sys.executable, "-c", BUSY]))
            stack.callback(process.kill)
        yield


class Steps:
    """Steps of one view for some seconds; see `baselines.training.loop.Trainer`."""

    iterations = 10**9

    def __init__(self, seconds: float) -> None:
        camera = view(*SIZE)
        self._camera, self._seconds = camera, seconds
        self._backend = CpuBackend(Objective(picture(camera)), np.zeros(3, np.float32), 0.01)
        self._backend.put(fresh_state(room(GAUSSIANS, camera)))
        self._settings = still()
        self.iteration, self.seconds = 0, 0.0
        self.step()
        self.iteration, self._start = 0, time.perf_counter()

    @property
    def taken(self) -> float:
        """Seconds since the first step that counts."""
        return time.perf_counter() - self._start

    @property
    def finished(self) -> bool:
        """Whether time is up."""
        return self.iteration > 0 and self.taken > self._seconds

    def step(self) -> Mapping[str, float]:
        """Take one."""
        rates, options = self._settings
        self._backend.step(self._camera, 0, self.iteration, 3, rates, options)
        self.iteration += 1
        return {"loss": 0.0}

    def state_dict(self) -> Tree:
        """Nothing that anybody goes on from."""
        return {"iteration": self.iteration}

    def load_state_dict(self, tree: Tree) -> None:
        """Nothing to take over."""


def measured(threads: int, seconds: float) -> float:
    """Steps a second in this process."""
    numba.set_num_threads(threads)
    with tempfile.TemporaryDirectory() as folder:
        steps = Steps(seconds)
        run(steps, Path(folder) / CHECKPOINT, {}, checkpoint_seconds=3600)
        return steps.iteration / steps.taken


def case(threads: int, competing: int, seconds: float) -> float:
    """Steps a second in a process of its own, beside others."""
    command = [sys.executable, "-m", "benchmarks.busy_machine", "--alone", json.dumps([threads, seconds])]
    with busy(competing):
        said = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    return float(said.splitlines()[-1])


def table_of(threads: tuple[int, ...], competing: tuple[int, ...], seconds: float, turns: int) -> pd.DataFrame:
    """A row a case, medians over turns; the idle case of each number of threads comes first."""
    rows: list[dict[str, Any]] = []
    for n in threads:
        idle = 0.0
        for others in tqdm((0, *competing), desc=f"{n} threads", leave=False):
            steps = float(np.median([case(n, others, seconds) for _ in range(turns)]))
            idle = idle or steps
            share = fair_share(steps, idle, n, others, processors())
            rows.append({"threads": n, "competing": others, "steps/s": round(steps, 1), "fair share": round(share, 2)})
    return pd.DataFrame(rows)


def main(
    out: Path = Path("results/bench"),
    threads: tuple[int, ...] = (1, 2),
    competing: tuple[int, ...] = (1, 2, 5),
    seconds: float = 20.0,
    turns: int = 3,
    alone: str = "",
) -> None:
    """Measure and report.

    Args:
        out: where the file goes.
        threads: of the training.
        competing: processes beside it.
        seconds: of steps in each case.
        turns: of each case.
        alone: for the processes of cases.
    """
    if alone:
        n, length = json.loads(alone)
        warm_up(3)
        print(measured(int(n), float(length)))
        return
    table = table_of(threads, competing, seconds, turns)
    print(table.to_string(index=False))
    write_bytes(out / "busy_machine.csv", table.to_csv(index=False).encode())


if __name__ == "__main__":
    run_command(main, prog="benchmarks.busy_machine")
