"""All kernels at once: compiled where they are not yet, and loaded before the clock of a training runs."""

import hashlib
import os
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from baselines.splatting import schedule
from baselines.splatting.backends import CpuBackend
from baselines.splatting.densification import Densification
from baselines.splatting.initialisation import initialise
from baselines.splatting.jit import FOLDER, HERE
from baselines.splatting.objective import Objective, TrainingImages
from baselines.splatting.relocation import Relocation
from baselines.splatting.schedule import LearningRates
from baselines.splatting.state import fresh_state
from hydroviews.cameras import Camera
from hydroviews.commands import run_process
from hydroviews.files import write_bytes
from hydroviews.scenes import no_points


def warm_up(sh_degree: int) -> float:
    """Load every kernel, so that training time is training; seconds.

    Kernels that were never compiled are compiled by a process of their own: code fresh from the compiler rounds
    differently from the same code read back from the cache, and a run must not depend on being the first.
    """
    start = time.perf_counter()
    mark = Path(FOLDER) / f"compiled-{_sources_digest()}"
    if not mark.is_file():
        print("compiling the kernels: once, up to a minute", file=sys.stderr, flush=True)
        code = f"from {__name__} import exercise_kernels; exercise_kernels({sh_degree})"
        run_process([sys.executable, "-c", code], {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)})
        write_bytes(mark, b"")
    exercise_kernels(sh_degree)
    return time.perf_counter() - start


def exercise_kernels(sh_degree: int) -> None:
    """One step of training on a scene of a few Gaussians."""
    camera = Camera(16, 16, 16.0, 16.0, 8.0, 8.0, np.diag([1.0, 1, 1, 1]))
    gaussians = initialise(no_points(), [camera], sh_degree, 0).select(np.arange(8))
    gaussians = replace(gaussians, means=gaussians.means + np.array([0, 0, 3], np.float32))
    grey = Objective(TrainingImages([np.full((16, 16, 3), 128, np.uint8)]))
    backend = CpuBackend(grey, np.zeros(3, np.float32), 0.01)
    backend.put(fresh_state(gaussians))
    rates = schedule.rates_at(0, 1, LearningRates(), 1.0, sh_degree)
    for strategy in (Densification(), Relocation()):
        backend.step(camera, 0, 0, sh_degree, rates, strategy.duties(0, 1e-4, 1.0, 0))


def _sources_digest() -> str:
    """Changes with any of our files: a kernel that was edited is compiled again, and by a process of its own."""
    return hashlib.sha256(b"".join(path.read_bytes() for path in sorted(HERE.glob("*.py")))).hexdigest()[:12]
