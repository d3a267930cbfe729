"""A leaderboard of made-up runs: records, scores of views, learning curves and renders, no training."""

import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pandas as pd

from baselines.training.learning_curve import LEARNING_CURVE, ROWS, write_rows
from hydroviews.metrics import find_metrics
from leaderboard.records import Record, columns, run_folder, write_record

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

    Each has scores of `n_views` held-out views, and renders of a size, width and height.
    """
    rng = np.random.default_rng(0)
    for method, scene, seed in itertools.product(methods, scenes, seeds):
        for pattern in ["clean"] if method == "3dgs-clean" else patterns:
            _write_run(results, rng, n_views, size, (method, scene, pattern, seed))


def run_row(method: str, scene: str, pattern: str, seed: int = 0, **more: Any) -> dict[str, Any]:
    """A finished run's row of a leaderboard, with the numbers that are given."""
    names = {"method": method, "scene": scene, "pattern": pattern, "effect": pattern.rpartition("-")[0] or pattern}
    usual = {"profile": "demo", "track": "given-poses", "submitted_by": "", "status": "done"}
    return dict.fromkeys(columns()) | names | usual | {"seed": seed, "data_sha256": f"{scene} {pattern}"} | more


def _write_run(results: Path, rng: np.random.Generator, n_views: int, size: tuple[int, int], run: tuple) -> None:
    method, scene, pattern, seed = run
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
    costs: dict[str, Any] = {
        name: float(rng.uniform(10, 1000)) for name in ("train_s", "peak_mem_mb", "model_mb", "render_fps")
    }
    costs |= {"n_primitives": int(counts[-1] * rng.uniform(0.5, 2)), "device": "cpu", "version": "0"}
    names = {"method": method, "scene": scene, "pattern": pattern, "effect": pattern.rpartition("-")[0] or pattern}
    facts = {"track": "given-poses", "profile": "demo", "status": "done", "reason": "", "n_train": 35}
    sizes = {"n_test": n_views, "width": size[0], "height": size[1], "data_sha256": f"{scene} {pattern}"}
    scores = {name: float(views[name].mean()) for name in metrics}
    write_record(folder, Record(**names, **facts, **sizes, **costs, seed=seed, scores=scores))
