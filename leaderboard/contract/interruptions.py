"""A training that is interrupted by Ctrl-C or SIGTERM and taken up again ends as one that was left alone.

A process ends with its training, and leaves nothing running. Every training runs in a process of its own, as runs of
the benchmark do, and long enough to be met half-way.
"""

import multiprocessing
import os
import shutil
import signal
import sys
import threading
import time
from dataclasses import dataclass
from functools import cache
from multiprocessing import resource_tracker
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any
from unittest import mock

from baselines.method import find_method
from hydroviews.cli.process_family import Family
from hydroviews.cli.processes import end_with_parent
from hydroviews.files.atomic import read_json, write_json
from hydroviews.scene.images import Image
from hydroviews.scene.scenes import Scene
from leaderboard.contract.case import Case, Failed, NotTestable, files_in, some
from leaderboard.runs.supervision import LINGER
from leaderboard.runs.train_and_render import only_training

SECONDS = 3.0  # of training, as far as the configured steps reach
SHORTEST = 0.1  # seconds of training below which nobody can meet it half-way
ATTEMPTS = 4  # to meet it half-way
PATIENCE = 60.0  # seconds until an interrupted process has to have ended
LOOK = 0.1  # seconds between two looks whether a process has ended
BEGUN, ENDED, LEFT, OUTPUT = "begun", "ended.json", "left.json", "output.txt"


@dataclass(frozen=True)
class LeftAlone:
    """A training that nobody disturbed."""

    config: Any
    steps: int
    folder: Path
    setup: float  # seconds from the start of `fit` to the first step
    seconds: float  # from there to the last
    left_running: list[str]  # threads and processes, in words

    @property
    def whole(self) -> float:
        """Seconds that `fit` took."""
        return self.setup + self.seconds

    def pixels(self, case: Case, folder: Path) -> list[Image]:
        """What a model renders that such a training has left in a folder."""
        return case.renders(case.kind.load(self.config, 0, folder))

    def require_same(self, case: Case, folder: Path, told: str) -> None:
        """Require of a training that it ended with the same pixels.

        Raises:
            Failed, NotTestable: as `Case.must_match`.
        """
        case.must_match(self.pixels(case, folder), self.pixels(case, self.folder), f"{told} other pixels")


@dataclass(frozen=True)
class Met:
    """A training that was stopped half-way."""

    folder: Path
    moment: float  # seconds from the start of `fit`
    left: list[str]  # files, to go on from


def ctrl_c(case: Case) -> str:
    """Ctrl-C, and on."""
    return _interrupted(case, signal.SIGINT)


def termination(case: Case) -> str:
    """SIGTERM, and on."""
    return _interrupted(case, signal.SIGTERM)


def nothing_left(case: Case) -> str:
    """No thread holds the process once the work is done, and no process is left running."""
    left = left_alone(case).left_running
    if left:
        raise Failed(f"left running: {', '.join(left)}")
    return "its process ended with its work, and left no other"


def _interrupted(case: Case, number: signal.Signals) -> str:
    alone = left_alone(case)
    if alone.seconds < SHORTEST:
        raise NotTestable(f"done before it can be met: {alone.seconds:.2f} s of training")
    return _goes_on(case, alone, _met(case, alone, number))


def _met(case: Case, alone: LeftAlone, number: signal.Signals) -> Met:
    """Meet a training half-way. The moment is bisected, as other things may keep the machine busy.

    Raises:
        Failed: interrupted, it ends as if it were done, with other pixels.
        NotTestable: every attempt came too late, or before the first checkpoint.
    """
    reason, early, late = "", 0.0, alone.whole
    moment = alone.whole - alone.seconds / 2
    for attempt in range(ATTEMPTS):
        folder = case.folder / f"{number.name}-{attempt}"
        exit_code = _run(case, alone.steps, folder, number, moment)
        left = files_in(folder)
        if (_notes(folder) / ENDED).exists():
            if exit_code == 0:
                alone.require_same(case, folder, f"after {number.name} fit returned as if it had ended, with")
            reason, late = f"done before it is met: {alone.seconds:.2f} s of training", moment
        elif left:
            return Met(folder, moment, left)
        else:
            reason, early = f"stopped after {moment:.1f} s, it leaves no checkpoint", moment
        moment = (early + late) / 2
    raise NotTestable(reason)


def _goes_on(case: Case, alone: LeftAlone, met: Met) -> str:
    """Take a training up again, and require that it ends as the one that was left alone.

    Raises:
        Failed: it does not go on, or ends with other pixels.
    """
    if _run(case, alone.steps, met.folder) != 0:
        raise Failed(f"stopped after {met.moment:.1f} s, it does not go on: {_last_words(met.folder)}")
    alone.require_same(case, met.folder, "taken up again, it ends with")
    return f"stopped after {met.moment:.1f} of {alone.whole:.1f} s, goes on from {some(met.left)}: the same pixels"


@cache
def left_alone(case: Case) -> LeftAlone:
    """Train for as many steps as take some seconds."""
    before = case.train(case.scene, "timed").summary().train_seconds
    steps = max(case.steps, round(case.steps * SECONDS / max(before, 1e-3)))
    folder = case.folder / "left-alone"
    if _run(case, steps, folder) != 0:
        raise Failed(f"in a process of its own, {steps} steps: {_last_words(folder)}")
    took = read_json(_notes(folder) / ENDED)
    seconds = min(took["fit"], took["training"])
    left = [*took["threads"], *read_json(_notes(folder) / LEFT)]
    return LeftAlone(case.config(steps), steps, folder, took["fit"] - seconds, seconds, left)


def _run(case: Case, steps: int, folder: Path, number: signal.Signals | None = None, moment: float = 0) -> int | None:
    """Train in a process of its own, and interrupt it so many seconds after `fit` began; its exit code."""
    notes = _notes(folder)
    shutil.rmtree(notes, ignore_errors=True)
    for new in (folder, notes):
        new.mkdir(parents=True, exist_ok=True)
    arguments = case.name, case.profile, steps, only_training(case.scene), folder, notes, os.getpid()
    process, family = multiprocessing.get_context("spawn").Process(target=_train, args=arguments), Family()
    resource_tracker.ensure_running()  # which is of all such processes, and none of the family
    with mock.patch.dict(os.environ, family.environment({})):
        process.start()
    assert process.pid is not None  # it has been started
    try:
        if number is not None:
            _interrupt(process, number, notes / BEGUN, moment)
        held = _wait(process, notes / ENDED)
    finally:
        process.kill()
        process.join()
        left = family.end(process.pid)
    write_json(notes / LEFT, [f"{left} processes"] if left else [])
    return 0 if held else process.exitcode


def _wait(process: BaseProcess, ended: Path) -> bool:
    """Wait until a process has ended; True, with the process as it is, where it does not though its work is done."""
    while process.is_alive():
        process.join(LOOK)
        if ended.exists() and process.is_alive():
            process.join(LINGER)
            return process.is_alive()
    return False


def _interrupt(process: BaseProcess, number: signal.Signals, begun: Path, moment: float) -> None:
    """Send a signal, unless the process ends before; it has to end then."""
    while not begun.exists() and process.is_alive():
        process.join(0.02)
    process.join(moment)
    if process.is_alive() and process.pid is not None:
        os.kill(process.pid, number)
        process.join(PATIENCE)
        if process.is_alive():
            raise Failed(f"{number.name} has not ended it after {PATIENCE:.0f} s")


def _train(name: str, profile: str, steps: int, scene: Scene, folder: Path, notes: Path, parent: int) -> None:
    """What the process does: as in a run of the benchmark, SIGINT is KeyboardInterrupt and SIGTERM ends it."""
    end_with_parent(parent)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, lambda received, _: sys.exit(128 + received))
    with (notes / OUTPUT).open("wb") as output:
        for stream in (1, 2):
            os.dup2(output.fileno(), stream)
    kind = find_method(name)
    method = kind(kind.with_max_iterations(kind.configuration(profile), steps), 0)
    (notes / BEGUN).touch()
    start = time.perf_counter()
    method.fit(scene, folder)
    seconds = time.perf_counter() - start
    method.save(folder)
    main = threading.main_thread()
    threads = [f"thread {one.name}" for one in threading.enumerate() if one is not main and not one.daemon]
    write_json(notes / ENDED, {"fit": seconds, "training": method.summary().train_seconds, "threads": threads})


def _notes(folder: Path) -> Path:
    """Where a process leaves word: not in the run's folder, which is the method's."""
    return folder.with_name(f"{folder.name}-notes")


def _last_words(folder: Path) -> str:
    """The last line that a process wrote."""
    lines = (_notes(folder) / OUTPUT).read_text(errors="replace").strip().splitlines()
    return lines[-1] if lines else "no word"
