"""The first half of a run, in a process of its own: train, save, render the held-out views to disk.

`evaluate` starts this for every run: python -m leaderboard.runs.train_and_render --run.method=3dgs ... It imports
little: not what scores, compares and shows runs.
"""

import resource
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
from tqdm import tqdm

from baselines.method import Method, check_hidden, check_render, find_method
from baselines.training.devices import warn_of_slow_profile
from hydroviews.cli.commands import run_command
from hydroviews.errors import InputError, MachineError
from hydroviews.files.atomic import write_json
from hydroviews.scene.images import write_png
from hydroviews.scene.scenes import Scene, Split
from leaderboard.runs.own_files import HIDDEN, PREDICTION, RENDERS, in_the_way, left_by_the_method
from leaderboard.runs.run import Run
from leaderboard.runs.sessions import noted, read_sessions, training_session
from leaderboard.runs.supervision import Tether, known_workers, tethered

DRAWN = (0.0, 0.5, 1.0)  # of the training views in their order, those of which they are


class RefusedByMethod(Exception):
    """A method has raised an InputError, or led to one: it has failed, and everybody else's runs go on."""


@contextmanager
def blaming_the_method() -> Iterator[None]:
    """Around what a method does, and what is made of it: an InputError is its own, but for one of the machine.

    Raises:
        RefusedByMethod: there was an InputError.
    """
    try:
        yield
    except MachineError:
        raise
    except InputError as error:
        raise RefusedByMethod(str(error)) from error


def train_and_render(run: Run) -> None:
    """Train the run's method, or go on from its checkpoint, and write `renders/` and `prediction.json`.

    Raises:
        InputError: data that cannot be used, no such method, or a full disk.
        Exception: whatever the method raises; where that is an InputError, a RefusedByMethod.
    """
    (run.folder / PREDICTION).unlink(missing_ok=True)  # renders are whole where it is, and now they change
    scene = run.training_scene()
    kind = find_method(run.method)
    warn_of_slow_profile(run.profile)
    with blaming_the_method():
        method = kind(kind.configuration(run.profile), run.seed)
        with training_session(run.folder):
            method.fit(only_training(scene), run.folder)
        method.save(run.folder)
        _render(method, scene, run.folder)


def _render(method: Method, scene: Scene, folder: Path) -> None:
    """Render with a trained method, and note what it is and cost.

    Raises:
        ValueError: it is nothing, renders something else than it has to, or has left something in the way.
    """
    from baselines.splatting.kernels.simd import SIMD

    summary = method.summary()
    if summary.n_primitives == 0:
        raise ValueError("training has left no Gaussians or other primitives: there is nothing to render")
    if left := in_the_way(folder):
        raise ValueError(left_by_the_method(left))
    seconds = render_views(method, scene, folder / RENDERS)
    draw_hidden(method, scene, folder / HIDDEN)
    write_json(
        folder / PREDICTION,
        {
            "train_s": round(summary.train_seconds, 1),
            "render_fps": round(1 / float(np.median(seconds)), 2),
            "peak_mem_mb": round(peak_memory_mb(), 1),
            "peak_gpu_mem_mb": peak_gpu_memory_mb(),
            "n_primitives": summary.n_primitives,
            "model_mb": summary.model_mb,
            "device": summary.device,
            "render_device": summary.render_device or summary.device,
            "simd": SIMD,
            "used": summary.used,
            "workers": known_workers(),
            **noted(read_sessions(folder)),
        },
    )


def only_training(scene: Scene) -> Scene:
    """The scene without its held-out views, so that nothing can be learned from them."""
    return replace(scene, views=scene.train_views, split=Split(scene.split.train, ()))


def render_views(method: Method, scene: Scene, folder: Path) -> list[float]:
    """Render the held-out views as 8-bit PNGs; returns the seconds each took.

    Raises:
        ValueError: a render is not what the contract promises.
    """
    seconds = []
    for view in tqdm(scene.test_views, desc="rendering", unit="view"):
        start = time.perf_counter()
        image = method.render(view.camera)
        seconds.append(time.perf_counter() - start)
        try:
            check_render(image, view.camera)
        except ValueError as error:
            raise ValueError(f"{view.name}: {error}") from None
        write_png(folder / f"{view.name}.png", image)
    return seconds


def draw_hidden(method: Method, scene: Scene, folder: Path) -> None:
    """Draw what the method takes for something before the scene in a few training views, if it looks for such.

    Raises:
        ValueError: it is not what the contract promises.
    """
    views = scene.train_views
    for index in sorted({round(share * (len(views) - 1)) for share in DRAWN}):
        size = views[index].camera.height, views[index].camera.width
        plane = method.hidden(index, size)
        if plane is None:
            return
        check_hidden(plane, size)
        write_png(folder / f"{views[index].name}.png", np.repeat(plane[..., None], 3, axis=2))


def peak_memory_mb() -> float:
    """The most memory this process has had, in 10^6 bytes.

    Where Linux tells it of the process itself: what `resource` tells there counts the parent's memory as well, if that
    was larger when it started this process.
    """
    if Path("/proc/self/status").is_file():
        lines = Path("/proc/self/status").read_text().splitlines()
        peaks = [line.split()[1] for line in lines if line.startswith("VmHWM:")]
        if peaks:
            return int(peaks[0]) * 1024 / 1e6
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 1e6 if sys.platform == "darwin" else peak * 1024 / 1e6


def peak_gpu_memory_mb() -> float | None:
    """The most memory that this process's tensors have had on the GPU, in 10^6 bytes; None where there were none."""
    torch = sys.modules.get("torch")  # who never imported it has nothing on a GPU
    peak = torch.cuda.max_memory_allocated() if torch else 0
    return round(peak / 1e6, 1) if peak else None


def main(run: Run, tether: Tether) -> None:
    """Train one run and render its held-out views; `evaluate` starts this for every run."""
    with tethered(tether):
        train_and_render(run)


if __name__ == "__main__":
    run_command(main, prog="leaderboard.runs.train_and_render")
