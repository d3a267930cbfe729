"""Training steps beside other processes that want the cores: steps a second, and the share of what is fair.

    python -m benchmarks busy_machine                          four minutes on two cores
    python -m benchmarks busy_machine --checkouts . ../other   seven minutes: another version of the code as well

Every case is a process of its own, beside competing processes that only count. The fair share of a training is
cores / (threads + competing) of its steps on an idle machine with as many threads. Threads that wait for others spin or
sleep, as WAITING says. The idle case is the one with threads that spin: a policy that slows an idle machine down shows
less than 1. The benchmark prints a table and writes `busy_machine.csv`. The machine has to be idle before.
"""

from hydroviews.cli.starting import begin

if __name__ == "__main__":
    begin()

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

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
SPLATTING, CONVOLUTIONS = "splatting", "convolutions"  # steps by Numba's threads, and by torch's
WAITING: dict[str, dict[str, str]] = {  # how long a thread of libgomp spins before it sleeps: the environment
    "spin": {"GOMP_SPINCOUNT": "300000"},  # libgomp's own default
    "spin shortly": {"GOMP_SPINCOUNT": "10000"},
    "ours": {},  # as commands do: like one of the others, by what runs when they start
    "sleep": {"OMP_WAIT_POLICY": "passive"},
}


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
    """Steps a second of splatting in this process."""
    numba.set_num_threads(threads)
    with tempfile.TemporaryDirectory() as folder:
        steps = Steps(seconds)
        run(steps, Path(folder) / CHECKPOINT, {}, checkpoint_seconds=3600)
        return steps.iteration / steps.taken


def convolutions(threads: int, seconds: float) -> float:
    """Steps a second of a small convolutional network in this process, as enhancement and features have them."""
    import torch

    torch.set_num_threads(threads)
    network = torch.nn.Sequential(*(torch.nn.Conv2d(24, 24, 3, padding=1) for _ in range(8)))
    picture, count = torch.zeros(1, 24, 75, 100), 0
    with torch.inference_mode():
        network(picture)
        start = time.perf_counter()
        while time.perf_counter() - start < seconds:
            network(picture)
            count += 1
    return count / (time.perf_counter() - start)


@dataclass(frozen=True)
class Case:
    """What is measured in a process of its own."""

    work: str
    threads: int
    waiting: str
    checkout: Path

    def steps(self, competing: int, seconds: float) -> float:
        """Steps a second beside so many processes."""
        alone = [self.threads, seconds, *([self.work] if self.work != SPLATTING else [])]
        command = [sys.executable, "-m", "benchmarks.busy_machine", "--alone", json.dumps(alone)]
        inherited = {name: value for name, value in os.environ.items() if not name.startswith(("OMP_", "GOMP_"))}
        environment = inherited | WAITING[self.waiting] | {"PYTHONPATH": str(self.checkout.resolve())}
        with busy(competing):
            process = subprocess.run(
                command, check=True, capture_output=True, text=True, env=environment, cwd=self.checkout
            )
        return float(process.stdout.splitlines()[-1])


def cases(checkouts: Sequence[Path]) -> list[Case]:
    """One thread, which waits for no other, and two of them under every policy; those of the default come first."""
    first = checkouts[0]
    found = [Case(SPLATTING, 1, "spin", first)]
    found += [Case(SPLATTING, 2, waiting, checkout) for checkout in checkouts for waiting in WAITING]
    return found + [Case(CONVOLUTIONS, 2, waiting, first) for waiting in WAITING]


def table_of(
    chosen: Sequence[Case],
    competing: Sequence[int],
    seconds: float,
    turns: int,
    steps_of: Callable[[Case, int, float], float] = Case.steps,
) -> pd.DataFrame:
    """A row for every case and number of competing processes, medians over turns.

    Args:
        chosen: cases; the first of each work and number of threads is the one that shares are of.
        competing: processes beside them; the idle machine comes in any case.
        seconds: of steps.
        turns: of each; those of different cases alternate.
        steps_of: measures one.
    """
    every = [(others, case) for others in (0, *competing) for _ in range(turns) for case in chosen]
    found: dict[tuple[int, Case], list[float]] = {}
    for others, case in tqdm(every, desc="cases", leave=False):
        found.setdefault((others, case), []).append(steps_of(case, others, seconds))
    rows, idle = [], dict[tuple[str, int], float]()
    for (others, case), turn in found.items():
        steps = float(np.median(turn))
        whole = idle.setdefault((case.work, case.threads), steps)
        share = fair_share(steps, whole, case.threads, others, processors())
        rows.append({**vars(case), "competing": others, "steps/s": round(steps, 2), "fair share": round(share, 2)})
    return pd.DataFrame(rows)


def main(
    out: Path = Path("results/bench"),
    checkouts: tuple[Path, ...] = (Path(),),
    competing: tuple[int, ...] = (2, 5),
    seconds: float = 6.0,
    turns: int = 1,
    alone: str = "",
) -> None:
    """Measure and report.

    Args:
        out: where the file goes.
        checkouts: versions of the code, the first one the one to compare with.
        competing: processes beside the training.
        seconds: of steps in each case.
        turns: of each case.
        alone: for the processes of cases.
    """
    if alone:
        n, length, *work = json.loads(alone)
        if work == [CONVOLUTIONS]:
            print(convolutions(int(n), float(length)))
            return
        warm_up(3)
        print(measured(int(n), float(length)))
        return
    table = table_of(cases(checkouts), competing, seconds, turns)
    print(table.to_string(index=False))
    write_bytes(out / "busy_machine.csv", table.to_csv(index=False).encode())


if __name__ == "__main__":
    run_command(main, prog="benchmarks.busy_machine")
