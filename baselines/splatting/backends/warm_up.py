"""All kernels at once: compiled where they are not yet, and loaded before the clock of a training runs."""

import logging
import os
import sys
import time
from collections.abc import Iterable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from baselines.splatting import schedule
from baselines.splatting.backends.base import CpuBackend
from baselines.splatting.initialisation import initialise
from baselines.splatting.kernels.jit import FOLDER, HERE, digest
from baselines.splatting.kernels.rasterizer import backward_sh_sets, render_sh_sets
from baselines.splatting.objective import Objective
from baselines.splatting.schedule import LearningRates
from baselines.splatting.state import fresh_state
from baselines.splatting.strategies.densification import DefaultStrategy
from baselines.splatting.strategies.relocation import MCMCStrategy
from baselines.training.images import TrainingImages
from hydroviews.cli.processes import run_process
from hydroviews.files.atomic import write_bytes
from hydroviews.files.locks import BUSY, locked
from hydroviews.scene.cameras import Camera
from hydroviews.scene.scenes import no_points

logger = logging.getLogger(__name__)


def warm_up(sh_degree: int) -> float:
    """Load every kernel, so that training time is training; seconds."""
    start = time.perf_counter()
    compile_apart(f"from {__name__} import exercise_kernels; exercise_kernels({sh_degree})", HERE.glob("*.py"))
    exercise_kernels(sh_degree)
    return time.perf_counter() - start


def compile_apart(code: str, sources: Iterable[Path]) -> None:
    """Have kernels that were never compiled compiled by a process of their own.

    Numba compiles the body of a parallel loop alone, and again within its kernel. Fresh from the compiler the first
    runs, and from the cache the second, which may round differently; a run must not depend on being the first.
    Of several that start together one compiles, and the others wait.

    Args:
        code: calls them all.
        sources: the files that they are in; an edited one is compiled again.
    """
    mark = Path(FOLDER) / f"compiled-{digest(sources)}"
    if mark.is_file():
        return
    with locked(mark, BUSY):
        if not mark.is_file():  # nor while waiting for another process
            logger.warning("compiling the kernels: once, up to a minute")
            run_process([sys.executable, "-c", code], {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)})
            write_bytes(mark, b"")


@cache
def exercise_kernels(sh_degree: int) -> None:
    """One step of training on a scene of a few Gaussians, and two sets of their colours; once a process."""
    camera = Camera(16, 16, 16.0, 16.0, 8.0, 8.0, np.diag([1.0, 1, 1, 1]))
    gaussians = initialise(no_points(), [camera], sh_degree, 0).select(np.arange(8))
    gaussians = replace(gaussians, means=gaussians.means + np.array([0, 0, 3], np.float32))
    grey = Objective(TrainingImages([np.full((16, 16, 3), 128, np.uint8)]))
    backend = CpuBackend(grey, np.zeros(3, np.float32), 0.01)
    backend.put(fresh_state(gaussians))
    rates = schedule.rates_at(0, 1, LearningRates(), 1.0, sh_degree)
    for strategy in (DefaultStrategy(), MCMCStrategy()):
        backend.step(camera, 0, 0, sh_degree, rates, strategy.step_options(0, 1e-4, 1.0, 0))
    images, state = render_sh_sets(gaussians, np.stack([gaussians.sh] * 2), camera)
    backward_sh_sets(state, images)
