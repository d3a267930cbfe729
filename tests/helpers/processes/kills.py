"""Commands that are killed, and whether they go on to the bytes of an undisturbed run."""

import hashlib
import multiprocessing
import os
import runpy
import shutil
import signal
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

import pandas as pd

from baselines.gaussian_splatting import GaussianSplatting
from baselines.splatting_profiles import PROFILES
from baselines.training.checkpoints import CHECKPOINT
from baselines.training.checkpoints import MODEL as MODEL_FILE
from baselines.training.learning_curve import LEARNING_CURVE
from hydroviews.errors import InputError
from hydroviews.files.locks import LOCK
from hydroviews.scene.seeds import generator
from leaderboard.records import LEADERBOARD, PER_VIEW
from leaderboard.runs.own_files import PREDICTION
from leaderboard.runs.run import Run, claim_folder
from leaderboard.runs.sessions import SESSIONS

METHOD, PROFILE = "kills:Brief", "demo"
RESULTS = "results"
ITERATIONS, CHECKPOINT_SECONDS = 200, 0.2
POLL = 0.005  # seconds
PARENT = "PARENT"  # in a command: the number of the process that starts it
IMPORTED = [
    "torch",
    "baselines.gaussian_splatting",
    "hydroviews.__main__",
    "leaderboard.__main__",
    "leaderboard.runs.train_and_render",
]
SERVER = multiprocessing.get_context("forkserver")
TIMED = ["before_s", "train_s", "after_s", "render_fps", "peak_mem_mb", "sessions"]  # columns of a leaderboard
Files = dict[str, str]  # SHA-256 by path


class Brief(GaussianSplatting):
    """Plain 3DGS in seconds, with a checkpoint every fifth of one."""

    profiles = {PROFILE: replace(PROFILES[PROFILE], iterations=ITERATIONS, checkpoint_seconds=CHECKPOINT_SECONDS)}  # noqa: RUF012


@dataclass(frozen=True)
class Stage:
    """A command that goes on where it was interrupted."""

    name: str
    result: str  # folder in which it is left undisturbed, for the next stage
    begin: Callable[[Path], Sequence[str]]  # makes what it starts from in a folder; the command that works there
    end: Callable[[Path], Files]  # what has to be the same afterwards


@dataclass(frozen=True)
class Undisturbed:
    """What a command does if it is left alone."""

    files: Files
    writing: float  # seconds from its first file to its end
    seconds: float  # in all


def stages(out: Path, patterns: Sequence[str]) -> Iterator[Stage]:
    """Building the room, training on it, scoring what was trained, each on what the one before left; all in a sweep."""
    built, trained, notes = out / "built", out / "trained", out / "notes"
    notes.mkdir(parents=True, exist_ok=True)

    def build(folder: Path) -> list[str]:
        target = [str(out / "room"), "--out", str(folder / PROFILE), "--profile", PROFILE]
        return ["hydroviews", "build", *target, "--patterns", *patterns]

    def train(folder: Path) -> list[str]:
        run = Run(METHOD, PROFILE, 0, built / PROFILE, "room", patterns[0], folder)
        claim_folder(run, overwrite=False)
        settings = [f"--run.{field.name}={getattr(run, field.name)}" for field in fields(run)]
        return ["leaderboard.runs.train_and_render", f"--tether.notes={notes}", f"--tether.parent={PARENT}", *settings]

    def score(folder: Path) -> list[str]:
        shutil.copytree(trained, folder, dirs_exist_ok=True)
        where = ["--data", str(built), "--results", str(folder), "--scene", "room"]
        return ["leaderboard", "score", "--method", METHOD, "--pattern", patterns[0], *where]

    def sweep(folder: Path) -> list[str]:
        where = ["--data", str(folder / "data"), "--results", str(folder / RESULTS), "--workers", "1"]
        what = ["--methods", METHOD, "--scenes", str(out / "room"), "--patterns", *patterns]
        return ["leaderboard", "sweep", *what, *where]

    timed = (PREDICTION, SESSIONS, LEARNING_CURVE, MODEL_FILE, CHECKPOINT)  # splats.ply has the same model
    yield Stage("build", "built", build, files_below)
    yield Stage("training", "trained", train, partial(files_below, unlike=timed))
    yield Stage("scoring", "scored", score, files_below)
    yield Stage("sweep", "swept", sweep, tables_below)


def tables_below(folder: Path) -> Files:
    """Hashes of a sweep's table without times, and of its scores by view."""
    table = pd.read_csv(folder / RESULTS / LEADERBOARD).drop(columns=TIMED)
    views = (folder / RESULTS / PER_VIEW).read_bytes()
    contents = {LEADERBOARD: table.to_csv(index=False).encode(), PER_VIEW: views}
    return {name: hashlib.sha256(content).hexdigest() for name, content in contents.items()}


def files_below(folder: Path, unlike: Sequence[str] = ()) -> Files:
    """Hashes of all files but locks, which name a process, and those that tell times."""
    found = (path for path in folder.rglob("*") if path.is_file() and not path.name.startswith(LOCK))
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(found)
        if path.name not in unlike
    }


def start(command: Sequence[str], output: Path) -> BaseProcess:
    """A module and its arguments as `python -m` runs them, in a process forked from one that has imported all."""
    process = SERVER.Process(target=_run, args=(command, output), daemon=True)
    process.start()
    return process


def _run(command: Sequence[str], output: Path) -> None:
    os.setsid()
    os.environ["HYDROVIEWS_DEVICE"] = "cpu"  # where sums have one order
    with output.open("wb") as file:
        for stream in (1, 2):
            os.dup2(file.fileno(), stream)
    sys.argv = [argument.replace(PARENT, str(os.getppid())) for argument in command]
    runpy.run_module(command[0], run_name="__main__", alter_sys=True)


def must_end(process: BaseProcess, output: Path) -> None:
    """Wait for a process.

    Raises:
        InputError: it fails.
    """
    process.join()
    if process.exitcode:
        raise InputError(f"{output}: status {process.exitcode}", found=output.read_text(errors="replace")[-500:])


def undisturbed(stage: Stage, folder: Path) -> Undisturbed:
    """Run a stage that nobody interrupts."""
    command, output = stage.begin(fresh(folder)), folder.with_suffix(".log")
    before, began = count_files(folder), time.perf_counter()
    process = start(command, output)
    wait_for_files(process, folder, before)
    first = time.perf_counter()
    must_end(process, output)
    end = time.perf_counter()
    return Undisturbed(stage.end(folder), end - first, end - began)


def fresh(folder: Path) -> Path:
    """An empty folder."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    return folder


def count_files(folder: Path) -> int:
    """Files in a folder that is being worked in, locks left out."""
    return sum(not name.startswith(LOCK) for _, _, names in os.walk(folder) for name in names)


def wait_for_files(process: BaseProcess, folder: Path, before: int) -> None:
    """Return once there are more files than before, or the process has ended."""
    while process.is_alive() and count_files(folder) <= before:
        process.join(POLL)


def killed(command: Sequence[str], folder: Path, seconds: float) -> bool:
    """Start a command and kill it and its children so long after its first file; whether it was still running."""
    before = count_files(folder)
    process = start(command, folder.with_suffix(".log"))
    wait_for_files(process, folder, before)
    process.join(seconds)
    alive = process.is_alive()
    if alive and process.pid is not None:
        os.killpg(process.pid, signal.SIGKILL)
    process.join()
    return alive


def kills(stage: Stage, folder: Path, alone: Undisturbed, count: int, seed: int) -> dict[str, Any]:
    """Kill a stage at `count` random moments, once a run, and go on: a row of the table."""
    random, ends, output = generator(seed, "kills", stage.name), Counter[str](), folder.with_suffix(".log")
    for _ in range(count):
        command, latest = stage.begin(fresh(folder)), alone.writing
        while not killed(command, folder, float(random.uniform(0, latest))):
            command, latest = stage.begin(fresh(folder)), latest / 2  # it was quicker than the undisturbed one
        try:
            must_end(start(command, output), output)
            ends["same bytes" if stage.end(folder) == alone.files else "other bytes"] += 1
        except InputError as error:
            print(error)
            ends["does not go on"] += 1
    found = {name: ends[name] for name in ("same bytes", "other bytes", "does not go on")}
    return {"stage": stage.name, "seconds": round(alone.seconds, 1), "kills": count, **found}
