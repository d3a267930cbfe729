"""All kernels at once: compiled where they are not yet, and loaded before the clock of a training runs."""

import logging
import os
import sys
import time
from collections.abc import Iterable
from dataclasses import replace
from functools import cache
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from baselines.splatting import schedule
from baselines.splatting.backends.base import CpuBackend
from baselines.splatting.gaussians import Gaussians
from baselines.splatting.kernels.adam import adam_step
from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.kernels.jit import FOLDER, SOURCES, digest
from baselines.splatting.objective import Objective
from baselines.splatting.rasterizer import backward_sh_sets, render_sh_sets
from baselines.splatting.schedule import LearningRates
from baselines.splatting.state import fresh_state
from baselines.splatting.strategies.densification import DefaultStrategy
from baselines.splatting.strategies.initialisation import initialise
from baselines.splatting.strategies.relocation import MCMCStrategy, add_noise
from baselines.training.images import TrainingImages
from hydroviews.cli.processes import run_process
from hydroviews.files.atomic import write_bytes
from hydroviews.files.locks import BUSY, locked
from hydroviews.scene.cameras import Camera
from hydroviews.scene.scenes import no_points

logger = logging.getLogger(__name__)


def warm_up(sh_degree: int, sh_sets: bool = False) -> float:
    """Load the kernels of a step, so that training time is training; seconds.

    Args:
        sh_degree: of the Gaussians.
        sh_sets: those that render several sets of coefficients at once as well, which few methods need.
    """
    start = time.perf_counter()
    compile_apart("steps", f"from {__name__} import compile_steps; compile_steps({sh_degree})", SOURCES)
    exercise_steps(sh_degree)
    if sh_sets:
        compile_apart("sh-sets", f"from {__name__} import exercise_sh_sets; exercise_sh_sets()", SOURCES)
        exercise_sh_sets()
    return time.perf_counter() - start


def compile_apart(name: str, code: str, sources: Iterable[Path]) -> None:
    """Have kernels that were never compiled compiled by a process of their own.

    Numba compiles the body of a parallel loop alone, and again within its kernel. Fresh from the compiler the first
    runs, and from the cache the second, which may round differently; a run must not depend on being the first.
    Of several that start together one compiles, and the others wait.

    Args:
        name: of them all together.
        code: calls them all.
        sources: the files that they are in; an edited one is compiled again.
    """
    mark = Path(FOLDER) / f"compiled-{name}-{digest(sources)}"
    if mark.is_file():
        return
    with locked(mark, BUSY):
        if not mark.is_file():  # nor while waiting for another process
            logger.warning("compiling the kernels: once, up to a minute")
            run_process([sys.executable, "-c", code], {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)})
            write_bytes(mark, b"")


def compile_steps(sh_degree: int) -> None:
    """Compile what `exercise_steps` calls; what comes after the picture in a second process."""
    second = get_context("spawn").Process(target=exercise_loss_and_adam, args=(sh_degree,))
    second.start()
    exercise_steps(sh_degree)
    second.join()


@cache
def exercise_steps(sh_degree: int) -> None:
    """A step of training on a few Gaussians with each strategy; once a process."""
    camera, gaussians = _few_gaussians(sh_degree)
    backend = CpuBackend(_grey_view(), np.zeros(3, np.float32), 0.01)
    backend.put(fresh_state(gaussians))
    rates = schedule.rates_at(0, 1, LearningRates(), 1.0, sh_degree)
    for strategy in (DefaultStrategy(), MCMCStrategy()):
        backend.step(camera, 0, 0, sh_degree, rates, strategy.step_options(0, 1e-4, 1.0, 0))


def exercise_loss_and_adam(sh_degree: int) -> None:
    """What a step of training does after the picture is there: the loss, Adam, noise."""
    _grey_view()(np.zeros((16, 16, 3), np.float32), 0, 0, BufferPool())
    _, gaussians = _few_gaussians(sh_degree)
    state = fresh_state(gaussians)
    means, nothing = gaussians.means, np.zeros_like(gaussians.means)
    adam_step(means, nothing, state.first.means, state.second.means, 1, 1e-4)
    noise = MCMCStrategy().step_options(0, 1e-4, 1.0, 0).noise
    assert noise is not None
    add_noise(gaussians, noise, nothing)


@cache
def exercise_sh_sets() -> None:
    """A render of a few Gaussians in two sets of coefficients, and its gradient; once a process."""
    camera, gaussians = _few_gaussians(0)
    images, rendered = render_sh_sets(gaussians, np.stack([gaussians.sh] * 2), camera)
    backward_sh_sets(rendered, images)


def _few_gaussians(sh_degree: int) -> tuple[Camera, Gaussians]:
    """A camera, and eight Gaussians before it."""
    camera = Camera(16, 16, 16.0, 16.0, 8.0, 8.0, np.diag([1.0, 1, 1, 1]))
    gaussians = initialise(no_points(), [camera], sh_degree, 0).select(np.arange(8))
    return camera, replace(gaussians, means=gaussians.means + np.array([0, 0, 3], np.float32))


def _grey_view() -> Objective:
    return Objective(TrainingImages([np.full((16, 16, 3), 128, np.uint8)]))
