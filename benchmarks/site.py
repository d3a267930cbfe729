"""What the pages of the leaderboard cost: processor seconds and memory for a board of made-up runs.

    python -m benchmarks.site --runs 1000

Records, scores of views, learning curves and renders are made up; gathering and writing are measured together, once
from nothing and once where the pages are there already.
"""

import dataclasses
import itertools
import resource
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pandas as pd

from baselines.training.learning_curve import LEARNING_CURVE, ROWS, write_rows
from hydroviews.cli.commands import run_command
from hydroviews.metrics import find_metrics
from leaderboard.gather import write_leaderboard
from leaderboard.records import Record, run_folder, write_record
from leaderboard.site.write import SITE, write_site

SCENES = ("room", "street", "pond", "market", "ngp_fox", "courtyard", "llff_flower", "mipnerf360_bonsai")
EFFECTS = ("raindrop", "streak", "storm")
SIZE = (320, 240)


def write_board(
    results: Path,
    methods: Sequence[str],
    scenes: Sequence[str],
    patterns: Sequence[str],
    seeds: Sequence[int] = (0,),
    n_views: int = 5,
    size: tuple[int, int] = SIZE,
) -> None:
    """Write finished runs of every method on every scene, pattern and seed; `3dgs-clean` runs on clean views.

    Args:
        results: their folder.
        methods: names.
        scenes: names.
        patterns: names, such as raindrop-1.
        seeds: of the runs.
        n_views: held out of each.
        size: of the renders, width and height.
    """
    rng = np.random.default_rng(0)
    for method, scene, seed in itertools.product(methods, scenes, seeds):
        for pattern in ["clean"] if method == "3dgs-clean" else patterns:
            _write_run(results, rng, n_views, size, (method, scene, pattern, seed))


def _write_run(
    results: Path, rng: np.random.Generator, n_views: int, size: tuple[int, int], names: tuple[str, str, str, int]
) -> None:
    method, scene, pattern, seed = names
    folder = run_folder(results, "demo", method, scene, pattern, seed, "given-poses")
    (folder / "renders").mkdir(parents=True)
    metrics = [metric.name for metric in find_metrics()]
    views = pd.DataFrame({name: rng.uniform(0.1, 30, n_views) for name in metrics})
    views.insert(0, "view", [f"{8 * i:03}" for i in range(n_views)])
    views.to_csv(folder / "per_view.csv", index=False)
    for view in views.view:
        coarse = rng.integers(0, 256, (size[1] // 8, size[0] // 8, 3), np.uint8)
        cv2.imwrite(str(folder / "renders" / f"{view}.png"), cv2.resize(coarse, size, interpolation=cv2.INTER_CUBIC))
    seconds, losses = np.linspace(0.5, 50, ROWS), np.exp(-np.linspace(0, 3, ROWS)) * rng.uniform(0.9, 1.1, ROWS)
    counts = np.linspace(8_000, 30_000, ROWS).astype(int)
    columns = ("step", "seconds", "loss", "Gaussians")
    write_rows(folder / LEARNING_CURVE, columns, zip(range(1, ROWS + 1), seconds, losses, counts, strict=True))
    record = Record(
        method=method,
        scene=scene,
        effect=pattern.rpartition("-")[0] or pattern,
        pattern=pattern,
        seed=seed,
        track="given-poses",
        status="done",
        reason="",
        n_train=35,
        n_test=n_views,
        width=size[0],
        height=size[1],
        scores={name: float(views[name].mean()) for name in metrics},
        profile="demo",
        data_sha256=f"{scene} {pattern}",
    )
    costs: dict[str, Any] = {
        name: float(rng.uniform(10, 1000)) for name in ("train_s", "peak_mem_mb", "model_mb", "render_fps")
    }
    costs |= {"n_primitives": int(counts[-1] * rng.uniform(0.5, 2)), "device": "cpu", "version": "0"}
    write_record(folder, dataclasses.replace(record, **costs))


def main(runs: int = 1000, seeds: int = 3) -> None:
    """Measure a board.

    Args:
        runs: at least so many.
        seeds: of every method.
    """
    patterns = [f"{effect}-{i}" for effect in EFFECTS for i in range(3)]
    n_methods = -(-runs // (len(SCENES) * len(patterns) * seeds))
    methods = ["3dgs-clean", *(f"method-{i}" for i in range(n_methods))]
    with tempfile.TemporaryDirectory(prefix="hydroviews-", dir=".") as folder:
        results = Path(folder)
        write_board(results, methods, SCENES, patterns, range(seeds))
        for title in ("from nothing", "there already"):
            start = time.process_time()
            table = write_leaderboard(results)
            gathered = time.process_time() - start
            write_site(table, results, results / "no data")
            seconds = time.process_time() - start
            size = sum(path.stat().st_size for path in (results / SITE).rglob("*") if path.is_file()) / 1e6
            peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
            print(
                f"{title}: {len(table)} runs, {seconds:.1f} s, {gathered:.1f} s of them gathering and tables; "
                f"peak memory {peak:.0f} MB; {size:.0f} MB on disk"
            )


if __name__ == "__main__":
    run_command(main, prog="benchmarks.site")
