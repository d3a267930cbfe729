"""Speed of one training step, kernel by kernel, and its error against float64.

    python -m benchmarks.splatting --folder results/bench

Prints both tables and writes splatting-speed.csv and splatting-error.csv.
"""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pandas as pd
import torch
import tyro
from tqdm import tqdm

from baselines.splatting import (
    backends,
    binning,
    blending,
    blending_gradient,
    objective,
    projection,
    projection_gradient,
    rasterizer,
    reference,
)
from baselines.splatting.densification import Densification, fresh_state
from baselines.splatting.gaussians import FIELDS, Gaussians
from baselines.splatting.objective import Objective, TrainingImages
from baselines.splatting.schedule import LearningRates, rates_at
from baselines.splatting.trainer import warm_up
from hydroviews.cameras import Camera
from hydroviews.files import write_bytes

COUNTS = (10_000, 30_000, 50_000)
SIZES = ((400, 300), (800, 600))
COVER = 25.0  # sum of all ellipse areas over the image's: about what a trained indoor scene has
STAGES = {
    "project": (projection, "project"),
    "sort": (binning, "depth_order"),
    "count": (binning, "count_pairs"),
    "deal": (binning, "deal_pairs"),
    "blend": (blending, "blend"),
    "loss": (objective, "photometric_loss"),
    "blend gradient": (blending_gradient, "blend_gradient"),
    "project gradient": (projection_gradient, "project_gradient"),
    "observe": (backends, "observe"),
    "adam": (backends, "adam_step"),
}


def room(n: int, camera: Camera, seed: int = 0) -> Gaussians:
    """An object in a room: half the Gaussians on a shell, half all around, sized to COVER the image."""
    generator = np.random.default_rng(seed)
    shell = generator.normal(size=(n // 2, 3))
    shell *= generator.uniform(0.7, 1, (n // 2, 1)) / np.linalg.norm(shell, axis=1, keepdims=True)
    means = np.concatenate([shell, generator.uniform(-4, 4, (n - n // 2, 3))])[generator.permutation(n)]
    shapes = generator.normal(0, 0.4, (n, 1)) + generator.normal(0, 0.5, (n, 3))
    logits = generator.normal(0, 1.8, n)
    sh = generator.normal(0, 0.05, (n, 16, 3))
    sh[:, 0] = generator.uniform(-1.7, 1.7, (n, 3))
    pixels, depth = camera.project(means)
    seen = (depth > 0.3) & (pixels >= 0).all(1) & (pixels < (camera.width, camera.height)).all(1)
    reach = 2 * np.log(np.maximum(255 / (1 + np.exp(-logits)), 1))  # squared radius at alpha 1/255, in deviations

    def cover(log_size: float) -> float:
        axes = np.sort(np.exp(shapes + log_size), axis=1)[:, 1:] * camera.fx / np.maximum(depth, 0.3)[:, None]
        return float((np.pi * reach * np.sqrt(axes**2 + 0.3).prod(axis=1))[seen].sum()) / (camera.width * camera.height)

    low, high = -12.0, 2.0
    for _ in range(40):
        middle = (low + high) / 2
        low, high = (low, middle) if cover(middle) > COVER else (middle, high)
    quaternions = generator.normal(size=(n, 4))
    values = dict(zip(FIELDS, (means, quaternions, shapes + low, logits, sh), strict=True))
    arrays = {name: np.ascontiguousarray(value, np.float32) for name, value in values.items()}
    return Gaussians(**arrays, origin=np.zeros(3))


def view(width: int, height: int) -> Camera:
    """Four units in front of the origin."""
    pose = np.eye(4)
    pose[2, 3] = 4
    return Camera(width, height, 0.9 * width, 0.9 * width, width / 2, height / 2, pose)


def picture(camera: Camera) -> TrainingImages:
    """One random picture to compare with."""
    shape = (camera.height, camera.width, 3)
    return TrainingImages([np.random.default_rng(0).integers(0, 256, shape, np.uint8)])


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


def speed(n: int, camera: Camera, repeats: int) -> dict[str, Any]:
    """Median milliseconds of a step and of its stages."""
    backend = backends.CpuBackend(Objective(picture(camera)), np.zeros(3, np.float32), 0.01)
    backend.put(fresh_state(room(n, camera)))
    rates = rates_at(0, 1, LearningRates(means=1e-12, means_final=1e-12, sh=0, sh_rest=0, opacity=0, scales=0,
                                         quaternions=0), 1.0, 3)  # fmt: skip
    turns = []
    for iteration in range(repeats + 3):
        with timed() as seconds:
            start = time.perf_counter()
            backend.step(camera, 0, iteration, 3, rates, Densification())
            turns.append({"step": time.perf_counter() - start, **seconds})
    milliseconds = (1000 * pd.DataFrame(turns[3:]).median()).round(2)
    about = {"gaussians": n, "size": f"{camera.width}x{camera.height}", "threads": numba.get_num_threads()}
    return {**about, **milliseconds}


def error(degree: int, n: int = 1500) -> dict[str, Any]:
    """Largest image error, and gradient errors relative to each Gaussian's own gradient."""
    camera = view(96, 72)
    gaussians = room(n, camera, seed=degree)
    weights = np.random.default_rng(degree).normal(size=(72, 96, 3)).astype(np.float32)
    image, state = rasterizer.render(gaussians, camera, sh_degree=degree)
    gradients = rasterizer.backward(state, weights).parameters.arrays()
    parameters = reference.tensors(gaussians)
    exact = reference.render(parameters, camera, torch.zeros(3), degree)
    (exact * torch.from_numpy(weights)).sum().backward()
    row: dict[str, Any] = {"sh degree": degree, "image": float(np.abs(image - exact.detach().numpy()).max())}
    for name in FIELDS:
        gradient = parameters[name].grad
        assert gradient is not None
        theirs, ours = gradient.numpy().reshape(n, -1), gradients[name].reshape(n, -1)
        size = np.linalg.norm(theirs, axis=1)
        relative = (np.linalg.norm(ours - theirs, axis=1) / np.maximum(size, 1e-30))[size > 1e-4 * size.max()]
        row |= {f"{name} median": float(np.median(relative)), f"{name} p99": float(np.quantile(relative, 0.99))}
    return row


def main(folder: Path = Path("results/bench"), repeats: int = 15) -> None:
    """Measure and report.

    Args:
        folder: where the CSV files go.
        repeats: timed steps of each case, after three that are not.
    """
    print(f"kernels ready after {warm_up(3):.1f} s")
    cases = [(n, view(*size)) for size in SIZES for n in COUNTS]
    speeds = pd.DataFrame([speed(n, camera, repeats) for n, camera in tqdm(cases, desc="speed", leave=False)])
    errors = pd.DataFrame([error(degree) for degree in tqdm(range(4), desc="error", leave=False)])
    print(f"\nmilliseconds\n{speeds.to_string(index=False)}")
    print(f"\nerror against float64\n{errors.to_string(index=False, float_format='{:.1e}'.format)}")
    for name, table in (("speed", speeds), ("error", errors)):
        write_bytes(folder / f"splatting-{name}.csv", table.to_csv(index=False).encode())


if __name__ == "__main__":
    tyro.cli(main)
