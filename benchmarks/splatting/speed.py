"""How long a training step takes, where the time goes, and how it grows."""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numba
import numpy as np
import pandas as pd

from baselines.splatting import objective
from baselines.splatting.backends import base as backends
from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.kernels.splats import projection, projection_gradient
from baselines.splatting.kernels.tiles import binning, blending, blending_gradient
from baselines.splatting.objective import Objective
from baselines.splatting.rasterizer import backward, backward_sh_sets, render, render_sh_sets
from baselines.splatting.schedule import LearningRates, rates_at
from baselines.splatting.state import fresh_state
from baselines.splatting.strategies.base import StepOptions
from baselines.splatting.strategies.densification import DefaultStrategy
from benchmarks.splatting.scenes import picture, room, view
from benchmarks.tables import rows_of

COUNTS = (10_000, 30_000, 50_000, 200_000)
SIZES = ((400, 300), (800, 600))
GROWING_COUNTS = (5_000, 10_000, 20_000, 50_000, 100_000, 200_000, 400_000)
GROWING_SIZES = ((160, 120), (240, 180), (400, 300), (640, 480), (800, 600), (1200, 900), (1600, 1200))
SETS, COLOURED = (1, 2, 3), (30_000, 60_000)
STAGES = {
    "project": (projection, "project"),
    "sort": (binning, "sort_by_depth"),
    "count": (binning, "count_room"),
    "list": (binning, "list_pairs"),
    "deal": (binning, "deal"),
    "blend": (blending, "blend"),
    "loss": (objective, "photometric_loss"),
    "blend gradient": (blending_gradient, "blend_gradient"),
    "project gradient": (projection_gradient, "project_gradient"),
    "observe": (backends, "observe"),
    "adam": (backends, "adam_step"),
}
RASTER = ("project", "sort", "count", "list", "deal", "blend", "blend gradient", "project gradient")
STILL = LearningRates(means=1e-12, means_final=1e-12, sh=0, sh_rest=0, opacity=0, scales=0, quaternions=0)


def speeds(repeats: int) -> pd.DataFrame:
    """Milliseconds of a step for all counts, sizes and numbers of threads."""
    cases = [(n, size, threads) for threads in thread_counts() for size in SIZES for n in COUNTS]
    return rows_of(speed, [(*case, repeats) for case in cases], "speed")


def growth(repeats: int) -> pd.DataFrame:
    """Milliseconds of a step as Gaussians or pixels grow, for all numbers of threads."""
    cases: list[tuple[int, tuple[int, int]]] = [(n, SIZES[0]) for n in GROWING_COUNTS]
    cases += [(30_000, size) for size in GROWING_SIZES if size != SIZES[0]]
    turns = [(n, size, threads) for threads in thread_counts() for n, size in cases]
    return rows_of(speed, [(*turn, repeats) for turn in turns], "growth")


def colours(repeats: int) -> pd.DataFrame:
    """Milliseconds of rasterizing sets of colours and their gradients, at once and one by one, by threads."""
    cases = [(n, number, threads) for threads in thread_counts() for n in COLOURED for number in SETS]
    return rows_of(of_colours, [(*case, repeats) for case in cases], "colours")


def of_colours(n: int, number: int, threads: int, repeats: int) -> dict[str, Any]:
    """Median milliseconds of one number of sets of colours."""
    camera = view(*SIZES[0])
    gaussians, buffers = room(n, camera), BufferPool()
    sh = np.stack([gaussians.sh] * number)
    gradient = np.random.default_rng(0).normal(size=(number, camera.height, camera.width, 3)).astype(np.float32)

    def at_once() -> None:
        backward_sh_sets(render_sh_sets(gaussians, sh, camera, buffers=buffers)[1], gradient)

    def one_by_one() -> None:
        for each in gradient:
            backward(render(gaussians, camera, buffers=buffers)[1], each)

    before = numba.get_num_threads()
    numba.set_num_threads(threads)
    turns = [(_seconds(at_once), _seconds(one_by_one)) for _ in range(repeats + 3)]
    numba.set_num_threads(before)
    together, apart = 1000 * np.median(turns[3:], axis=0)
    about = {"gaussians": n, "size": f"{camera.width}x{camera.height}", "threads": threads, "sets": number}
    return about | {"at once": round(together, 2), "one by one": round(apart, 2)}


def _seconds(work: Callable[[], None]) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def still() -> tuple[dict[str, Any], StepOptions]:
    """Rates and options of a step that watches gradients and learns next to nothing, at degree 3."""
    return rates_at(0, 1, STILL, 1.0, 3), DefaultStrategy().step_options(0, 0.0, 1.0, 0)


def thread_counts() -> Sequence[int]:
    """1, 2, 4, ... up to what the machine has."""
    most = numba.config.NUMBA_NUM_THREADS
    return sorted({min(2**k, most) for k in range(most.bit_length() + 1)})


def speed(n: int, size: tuple[int, int], threads: int, repeats: int) -> dict[str, Any]:
    """Median milliseconds of a step, of its stages, of rasterizing forwards and backwards, and of the stages' sum."""
    camera = view(*size)
    backend = backends.CpuBackend(Objective(picture(camera)), np.zeros(3, np.float32), 0.01)
    backend.put(fresh_state(room(n, camera)))
    rates, step_options = still()
    before = numba.get_num_threads()
    numba.set_num_threads(threads)
    turns = []
    for iteration in range(repeats + 3):
        with timed() as seconds:
            start = time.perf_counter()
            backend.step(camera, 0, iteration, 3, rates, step_options)
            turns.append({"step": time.perf_counter() - start, **seconds})
    numba.set_num_threads(before)
    milliseconds = 1000 * pd.DataFrame(turns[3:]).median()
    about = {"gaussians": n, "size": f"{camera.width}x{camera.height}", "threads": threads}
    sums = {"raster": milliseconds[list(RASTER)].sum(), "step / kernels": milliseconds.step / milliseconds[1:].sum()}
    return (
        about
        | {"step": round(milliseconds.step, 2)}
        | {k: round(v, 2) for k, v in sums.items()}
        | {stage: round(milliseconds[stage], 2) for stage in STAGES}
    )


@contextmanager
def timed() -> Iterator[dict[str, float]]:
    """Seconds by stage, added up while the block runs."""
    seconds = dict.fromkeys(STAGES, 0.0)
    originals = {stage: getattr(*where) for stage, where in STAGES.items()}

    def watched(stage: str) -> Callable[..., Any]:
        def call(*arguments: Any, **options: Any) -> Any:
            start = time.perf_counter()
            result = originals[stage](*arguments, **options)
            seconds[stage] += time.perf_counter() - start
            return result

        return call

    for stage, (module, name) in STAGES.items():
        setattr(module, name, watched(stage))
    try:
        yield seconds
    finally:
        for stage, (module, name) in STAGES.items():
            setattr(module, name, originals[stage])
