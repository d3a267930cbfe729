"""Commands that are killed, and whether they go on to the bytes of an undisturbed run."""

import hashlib
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path

import pandas as pd

from baselines.gaussian_splatting import GaussianSplatting
from baselines.splatting_profiles import PROFILES
from baselines.training.checkpoints import CHECKPOINT
from baselines.training.checkpoints import MODEL as MODEL_FILE
from baselines.training.learning_curve import LEARNING_CURVE
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
        tether = [f"--tether.notes={notes}", f"--tether.parent={os.getpid()}"]
        return ["leaderboard.runs.train_and_render", *tether, *settings]

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


def start(command: Sequence[str], folder: Path) -> subprocess.Popen:
    """A module and its arguments, which work in a folder, on the CPU, where sums have one order."""
    environment = {**os.environ, "HYDROVIEWS_DEVICE": "cpu"}
    with folder.with_suffix(".log").open("wb") as log:
        streams = {"stdout": log, "stderr": log, "env": environment, "start_new_session": True}
        return subprocess.Popen([sys.executable, "-m", *command], **streams)


def fresh(folder: Path) -> Path:
    """An empty folder."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    return folder


def begun(command: Sequence[str], folder: Path) -> subprocess.Popen:
    """The process of a command, once it has written a file in its folder, or has ended."""
    before = _count_files(folder)
    process = start(command, folder)
    while process.poll() is None and _count_files(folder) <= before:
        time.sleep(POLL)
    return process


def _count_files(folder: Path) -> int:
    """Files in a folder that is being worked in, locks left out."""
    return sum(not name.startswith(LOCK) for _, _, names in os.walk(folder) for name in names)


def must_end(process: subprocess.Popen, folder: Path) -> None:
    assert process.wait() == 0, folder.with_suffix(".log").read_text(errors="replace")[-500:]


def undisturbed(stage: Stage, folder: Path) -> tuple[Files, float]:
    """The files that an uninterrupted stage leaves, and the seconds from its first file to its end."""
    process, first = begun(stage.begin(fresh(folder)), folder), time.perf_counter()
    must_end(process, folder)
    writing = time.perf_counter() - first
    return stage.end(folder), writing


def killed(command: Sequence[str], folder: Path, seconds: float) -> bool:
    """Start a command and kill it and its children so long after its first file; whether it was still running."""
    process = begun(command, folder)
    try:
        process.wait(seconds)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
    return process.wait() == -signal.SIGKILL


def kills(stage: Stage, folder: Path, writing: float, count: int) -> Iterator[Files]:
    """Kill a stage at `count` random moments, once a run, and go on: what it leaves."""
    random = generator(0, "kills", stage.name)
    for _ in range(count):
        command, latest = stage.begin(fresh(folder)), writing
        while not killed(command, folder, float(random.uniform(0, latest))):
            command, latest = stage.begin(fresh(folder)), latest / 2  # it was quicker than the undisturbed one
        must_end(start(command, folder), folder)
        yield stage.end(folder)
