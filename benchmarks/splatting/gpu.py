"""What a training costs on an NVIDIA GPU: a step and its parts, what lies between steps, and every method's own loss.

    python -m benchmarks gpu --folder results/bench --parts agree steps between methods losses

Nothing else should run on the machine. Prints tables and writes them as gpu-*.csv.
"""

import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd
import torch
from torch import Tensor

from baselines.gaussian_splatting import GaussianSplatting
from baselines.method import find_method
from baselines.splatting.backends.base import CpuBackend
from baselines.splatting.backends.cuda import CudaBackend, _upload
from baselines.splatting.files.checkpoints import state_to_tree
from baselines.splatting.objective import Objective
from baselines.splatting.rasterizer import backward, render
from baselines.splatting.state import fresh_state
from baselines.splatting.strategies.densification import DefaultStrategy
from baselines.training.checkpoints import save_checkpoint
from baselines.training.images import read_images
from benchmarks.methods import in_steps
from benchmarks.splatting.scenes import picture, room, view
from benchmarks.splatting.speed import still
from benchmarks.tables import report
from hydroviews.errors import InputError
from hydroviews.scene.images import write_png
from hydroviews.scene.scenes import Points, Scene, View, make_scene

Part = Literal["agree", "steps", "cpu", "kernels", "between", "methods", "losses"]
CASES = ((30_000, (320, 240)), (60_000, (400, 300)), (300_000, (1600, 1060)), (1_000_000, (1600, 1060)))
LARGEST = CASES[-1]
COMPARED = CASES[0], (300_000, (800, 600))  # with the CPU's kernels
GROWN_AT = 600  # a refinement is due after so many steps
BACKGROUND = np.zeros(3, np.float32)
METHODS = ("3dgs", "deraings", "deraings-plus", "desplat", "wild-gaussians", "gs-w", "wild-gs", "nerf-w", "ha-nerf")
LOSSES = ("3dgs", "deraings", "deraings-plus", "robust-filter", "desplat")
FOUND = ("needed", "mask_mean", "drops", "pixels")  # of a report
N_VIEWS, SEEN = 24, 300_000  # views and Gaussians with which losses are measured
LESSONS, MIDDLE = 120, 0.6  # steps from the start of a training to its middle, a share of its iterations
DROPS, DROP_SIZE = 60, 0.02  # on the lens, and their deviation in widths of the picture


def milliseconds(work: Callable[[], Any], repeats: int) -> float:
    """Mean of a row of turns that the CPU does not wait for one by one, as a training does, after five others."""
    for _ in range(5):
        work()
    torch.cuda.synchronize()
    start = time.perf_counter()
    for _ in range(repeats):
        work()
    torch.cuda.synchronize()
    return 1e3 * (time.perf_counter() - start) / repeats


def agree() -> pd.DataFrame:
    """The largest and mean difference of images, and the relative one of gradients a Gaussian, from the CPU's."""
    return pd.DataFrame([row for n, size in COMPARED for row in agreement(n, size)])


def agreement(n: int, size: tuple[int, int]) -> list[dict[str, Any]]:
    """One row for the image and one for each parameter's gradient; opacities are below both largest alphas."""
    camera = view(*size)
    camera = replace(camera, cx=camera.cx + 7.3, cy=camera.cy - 4.1)
    gaussians = room(n, camera)
    np.clip(gaussians.opacity_logits, None, 4, out=gaussians.opacity_logits)
    gradient = np.random.default_rng(1).normal(size=(*size[::-1], 3)).astype(np.float32)
    gpu = CudaBackend(Objective(picture(camera)), BACKGROUND, 0.01)
    leaves = {name: value.requires_grad_() for name, value in _upload(gaussians).items()}
    image, _ = gpu._rasterize(leaves, gaussians.origin, camera, 3)
    image.backward(torch.from_numpy(gradient).cuda())
    ours, rendered = render(gaussians, camera, BACKGROUND, 3, near=0.01)
    found = backward(rendered, gradient).parameters
    error = np.abs(image.detach().cpu().numpy() - ours)
    rows = [{**about(n, size), "of": "image", **spread(error)}]
    for name, leaf in leaves.items():
        theirs, mine = (value.reshape(n, -1) for value in (_gradient(leaf), getattr(found, name)))
        shown = np.abs(mine).max(1) > 0
        relative = np.abs(theirs - mine)[shown].max(1) / np.abs(mine[shown]).max(1)
        rows.append({**about(n, size), "of": name, **spread(relative)})
    return rows


def spread(errors: np.ndarray) -> dict[str, float]:
    """Columns for many errors."""
    return {"median": np.median(errors), "99 %": np.quantile(errors, 0.99), "most": errors.max()}


def _gradient(leaf: Tensor) -> np.ndarray:
    assert leaf.grad is not None
    return leaf.grad.cpu().numpy()


def steps(repeats: int = 50) -> pd.DataFrame:
    """Milliseconds of a step of plain splatting, its parts each alone, memory of the GPU; and the CPU's step."""
    rows = []
    for n, size in CASES:
        torch.cuda.reset_peak_memory_stats()
        step, parts = prepared(n, size)
        times = {"step": milliseconds(step, repeats)}
        times |= {name: milliseconds(part, repeats) for name, part in parts.items()}
        memory = torch.cuda.max_memory_allocated() / 1e6
        rows.append({**about(n, size), **times, "GPU MB": memory})
    return pd.DataFrame(rows)


def prepared(n: int, size: tuple[int, int]) -> tuple[Callable[[], Any], dict[str, Callable[[], Any]]]:
    """A whole step on made-up Gaussians that learn next to nothing, and parts of it."""
    camera = view(*size)
    gaussians, images = room(n, camera), picture(camera)
    backend = CudaBackend(Objective(images), BACKGROUND, 0.01)
    backend.put(fresh_state(gaussians))
    rates, options = still()
    leaves = {name: value.detach().requires_grad_() for name, value in backend._current().parameters.items()}
    image, _ = backend._rasterize(leaves, gaussians.origin, camera, 3)
    seen, ones = image.detach().requires_grad_(), torch.ones_like(image)

    def rasterize() -> None:
        with torch.no_grad():
            backend._rasterize(leaves, gaussians.origin, camera, 3)

    def both_ways() -> None:
        backend._rasterize(leaves, gaussians.origin, camera, 3)[0].backward(ones)

    parts = {
        "rasterize": rasterize,
        "and back": both_ways,
        "loss": lambda: backend._backward([seen], 0, 0),
    }
    return lambda: backend.step(camera, 0, 100, 3, rates, options), parts


def cpu_steps(repeats: int = 10) -> pd.DataFrame:
    """Milliseconds of the CPU's step at the two small sizes, all threads."""
    return pd.DataFrame([{**about(*case), "CPU step": cpu_step(*case, repeats)} for case in CASES[:2]])


def cpu_step(n: int, size: tuple[int, int], repeats: int) -> float:
    """Milliseconds of one of our kernels' steps."""
    camera = view(*size)
    backend = CpuBackend(Objective(picture(camera)), BACKGROUND, 0.01)
    backend.put(fresh_state(room(n, camera)))
    rates, options = still()
    return milliseconds(lambda: backend.step(camera, 0, 100, 3, rates, options), repeats)


def about(n: int, size: tuple[int, int]) -> dict[str, Any]:
    """The first columns of a row."""
    return {"Gaussians": n, "size": "{}x{}".format(*size)}


def kernels(steps: int = 10) -> pd.DataFrame:
    """The GPU's kernels that take most of a step of the largest case: milliseconds and launches a step."""
    step, _ = prepared(*LARGEST)
    for _ in range(5):
        step()
    with torch.profiler.profile(activities=[torch.profiler.ProfilerActivity.CUDA]) as profile:
        for _ in range(steps):
            step()
        torch.cuda.synchronize()
    events = sorted(profile.key_averages(), key=lambda event: -event.self_device_time_total)
    rows = [(event.key[:70], event.self_device_time_total / 1e3 / steps, event.count / steps) for event in events[:25]]
    return pd.DataFrame(rows, columns=["kernel", "ms", "launches"])


def between() -> pd.DataFrame:
    """Seconds of what lies between steps: copies of the state, a refinement that adds a tenth, a checkpoint."""
    n, size = LARGEST
    camera = view(*size)
    backend = CudaBackend(Objective(picture(camera)), BACKGROUND, 0.01)
    backend.put(fresh_state(room(n, camera)))
    strategy = DefaultStrategy(growth=0.1, grow_grad2d=-1.0, reset_every=None)
    rows = []

    def timed(what: str, work: Callable[[], Any]) -> Any:
        torch.cuda.synchronize()
        start = time.perf_counter()
        result = work()
        torch.cuda.synchronize()
        rows.append({**about(n, size), "what": what, "s": time.perf_counter() - start})
        return result

    state = timed("copy down", lambda: backend.get(GROWN_AT, 0.0))
    grown = timed("refine", lambda: strategy.refine(state, 4.0, 0))
    timed("copy up", lambda: backend.put(grown))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "checkpoint"
        timed("checkpoint", lambda: save_checkpoint(path, state_to_tree(grown), {}))
    return pd.DataFrame(rows)


def methods(names: Sequence[str], size: tuple[int, int], profile: str, steps: int) -> pd.DataFrame:
    """Milliseconds of a step of every method in a profile's settings, cut to so many steps, and seconds around them."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        scene = photographed(Path(folder) / "scene", size)
        for name in names:
            kind = find_method(name)
            method = kind(in_steps(kind.configuration(profile), steps), 0)
            (run := Path(folder) / name).mkdir()
            start = time.perf_counter()
            try:
                method.fit(scene, run)
                took = time.perf_counter() - start
                summary = method.summary()
                training = summary.train_seconds
                row = {"step ms": 1e3 * training / steps, "around s": took - training, "device": summary.device}
            except InputError as error:
                row = {"device": str(error).splitlines()[0]}
            rows.append({"method": name, "size": "{}x{}".format(*size), **row})
            print(rows[-1], flush=True)
    return pd.DataFrame(rows)


def losses(names: Sequence[str], size: tuple[int, int], profile: str, repeats: int) -> pd.DataFrame:
    """Milliseconds of a step in the middle of a training with drops on the lens, of methods with a loss of their own.

    Whatever a method looks for, it has found by then: trainings that are cut to few steps look for it in all of them.
    """
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        scene = photographed(Path(folder) / "scene", size, N_VIEWS, drops=True)
        for name in names:
            (run := Path(folder) / name).mkdir()
            rows.append({"method": name, "size": "{}x{}".format(*size), **loss_row(name, scene, run, profile, repeats)})
            print(rows[-1], flush=True)
    return pd.DataFrame(rows)


def loss_row(name: str, scene: Scene, run: Path, profile: str, repeats: int) -> dict[str, Any]:
    """Columns for one method that splats."""
    kind = find_method(name)
    method = kind(kind.configuration(profile), 0)
    assert isinstance(method, GaussianSplatting)
    objective = method.objective(scene, run) or Objective(read_images(scene.train_views))
    cameras = [view.camera for view in scene.train_views]
    backend = CudaBackend(objective, BACKGROUND, 0.01)
    backend.put(fresh_state(room(SEEN, cameras[0])))
    rates, options = still()
    steps = count()

    def step(iteration: int) -> None:
        index = next(steps) % len(cameras)
        backend.step(cameras[index], index, iteration, 3, rates, options)

    middle = round(MIDDLE * method.splatting.iterations)
    for share in np.arange(LESSONS) / LESSONS:
        step(round(share * middle) // 12 * 12)  # where masks, drops and rain learn
    iterations = count(middle)
    took = milliseconds(lambda: step(next(iterations)), repeats)
    return {"step ms": took, **{key: value for key, value in objective.report().items() if key in FOUND}}


def photographed(folder: Path, size: tuple[int, int], n_views: int = 6, drops: bool = False) -> Scene:
    """Pictures of made-up Gaussians from cameras on an arc, behind drops if wanted, and their centres as points."""
    front = view(*size)
    gaussians = room(30_000, front)
    gpu = CudaBackend(Objective(picture(front)), BACKGROUND, 0.01)
    alpha = lens(*size) if drops else np.float32(0)
    views = []
    for index in range(n_views):
        path = folder / f"{index}.png"
        camera = replace(front, world_to_camera=turned(front.world_to_camera, 0.1 * index))
        write_png(path, np.clip((1 - alpha) * gpu.render(gaussians, camera) + 0.5 * alpha, 0, 1))
        views.append(View(path.stem, camera, path))
    chosen = np.random.default_rng(0).permutation(len(gaussians))[:3000]
    colours = np.clip(255 * (0.5 + 0.282 * gaussians.sh[chosen, 0]), 0, 255).astype(np.uint8)
    return make_scene("made-up", views, Points(gaussians.means[chosen].astype(np.float64), colours))


def lens(width: int, height: int) -> np.ndarray:
    """What soft drops at chance places of the lens cover of each pixel [H, W, 1]."""
    y, x = np.mgrid[:height, :width].astype(np.float32) / np.float32(width)
    clear = np.ones((height, width), np.float32)
    for centre in np.random.default_rng(0).uniform((0, 0), (height / width, 1), (DROPS, 2)).astype(np.float32):
        clear *= 1 - 0.9 * np.exp(-((y - centre[0]) ** 2 + (x - centre[1]) ** 2) / (2 * DROP_SIZE**2))
    return (1 - clear)[..., None]


def turned(pose: np.ndarray, angle: float) -> np.ndarray:
    """A camera that has gone round the vertical axis of the world."""
    turn = np.eye(4)
    turn[[0, 0, 2, 2], [0, 2, 0, 2]] = np.cos(angle), np.sin(angle), -np.sin(angle), np.cos(angle)
    return pose @ turn


def main(
    folder: Path = Path("results/bench"),
    parts: tuple[Part, ...] = ("agree", "steps", "cpu", "kernels", "between", "methods", "losses"),
    names: tuple[str, ...] = (),
    size: tuple[int, int] = (1600, 1060),
    profile: str = "paper",
    steps_of_methods: int = 100,
) -> None:
    """Measure and report.

    Args:
        folder: where the files go.
        parts: what to measure.
        names: of the methods; by default some of every kind.
        size: width and height of the methods' pictures.
        profile: demo, quick or paper: settings of the methods.
        steps_of_methods: that each trains, or, for their losses, takes.
    """
    measure: dict[str, Callable[[], pd.DataFrame]] = {
        "agree": agree,
        "steps": steps,
        "cpu": cpu_steps,
        "kernels": kernels,
        "between": between,
        "methods": lambda: methods(names or METHODS, size, profile, steps_of_methods),
        "losses": lambda: losses(names or LOSSES, size, profile, steps_of_methods),
    }
    print(f"{torch.cuda.get_device_name()}, torch {torch.__version__}")
    for part in parts:
        report(measure[part](), folder / f"gpu-{part}.csv", part)
