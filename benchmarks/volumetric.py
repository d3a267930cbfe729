"""Speed and error of radiance fields: the hash grid's kernels, and what samples and tables cost and buy.

    python -m benchmarks volumetric --out results/bench
    python -m benchmarks volumetric --scene data/demo/courtyard --iterations 1500

Prints a table of the kernels against plain torch in float64 and writes volumetric-grid.csv; with a scene, trains a
plain field with one setting changed at a time and writes volumetric-settings.csv. Times are processor time, so that
what else runs on the machine counts little.
"""

import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from baselines.volumetric.config import HashFieldConfig, VolumetricConfig
from baselines.volumetric.fields.hash_grid import GridConfig, HashGrid, interpolate, warm_up
from baselines.volumetric.model import RadianceModel
from baselines.volumetric.trainer import train
from benchmarks.tables import report, rows_of
from benchmarks.timing import least
from hydroviews.dataset.variants import open_clean
from hydroviews.metrics import METRICS
from hydroviews.scene.scenes import Scene
from leaderboard.scoring.score import score_image

RAYS, SAMPLES = 1024, 24
GRIDS = (GridConfig(8, 14), GridConfig(8, 16), GridConfig(8, 18), GridConfig(5, 14, 16, 256), GridConfig(16, 16))
PLAIN = VolumetricConfig()
HASH = HashFieldConfig()
SETTINGS: dict[str, VolumetricConfig] = {
    "as it is": PLAIN,
    "12 samples": replace(PLAIN, samples=12),
    "48 samples": replace(PLAIN, samples=48),
    "24 samples of the proposal": replace(PLAIN, proposal_samples=24),
    "2^14 entries": replace(PLAIN, field=replace(HASH, grid=GridConfig(8, 14))),
    "2^18 entries": replace(PLAIN, field=replace(HASH, grid=GridConfig(8, 18))),
    "one layer of 32 for colours": replace(PLAIN, field=replace(HASH, hidden=32, colour_layers=1)),
    "twice the rate": replace(PLAIN, field=replace(HASH, rate=2 * HASH.rate)),
    "half the rate": replace(PLAIN, field=replace(HASH, rate=HASH.rate / 2)),
}


def main(out: Path = Path("results/bench"), scene: Path | None = None, iterations: int = 1500) -> None:
    """Measure and write.

    Args:
        out: folder of the CSV files.
        scene: a built scene, whose clean views are learned.
        iterations: of each training.
    """
    torch.set_num_threads(1)
    warm_up()
    report(rows_of(grid_row, [(config,) for config in GRIDS], "grids"), out / "volumetric-grid.csv")
    if scene:
        views = open_clean(scene)
        cases = [(name, replace(config, iterations=iterations), views) for name, config in SETTINGS.items()]
        report(rows_of(settings_row, cases, "settings"), out / "volumetric-settings.csv")


def ray_points() -> Tensor:
    """Points [R S, 3] along short rays in the unit cube, as a field is asked for them."""
    rng = np.random.default_rng(0)
    origins, directions = rng.random((RAYS, 1, 3)), rng.normal(size=(RAYS, 1, 3))
    along = np.linspace(0, 0.1, SAMPLES)[None, :, None]
    return torch.from_numpy(np.clip(origins + along * directions, 0, 1).reshape(-1, 3).astype(np.float32))


def grid_row(config: GridConfig) -> dict[str, Any]:
    """Milliseconds of a batch's lookup and of its gradient, ours and torch's, and errors against float64."""
    grid = HashGrid(config, torch.Generator().manual_seed(0))
    points, weights = ray_points(), torch.randn(RAYS * SAMPLES, grid.width, generator=torch.Generator().manual_seed(1))
    exact = grid.tables.detach().double().requires_grad_()
    truth = interpolate(points.double(), exact, grid.resolutions)
    (truth * weights).sum().backward()
    row: dict[str, Any] = {"levels": config.levels, "entries": 2**config.log2_entries, "finest": config.finest}
    ways: dict[str, Callable[[], Tensor]] = {
        "ours": lambda: grid(points),
        "torch": lambda: interpolate(points, grid.tables, grid.resolutions),
    }
    for name, way in ways.items():
        grid.tables.grad = None
        (way() * weights).sum().backward()
        assert grid.tables.grad is not None
        assert exact.grad is not None
        row[f"{name} error"] = relative(way().detach(), truth.detach())
        row[f"{name} gradient error"] = relative(grid.tables.grad, exact.grad)
        row[f"{name} ms"] = least(way, 5)
        row[f"{name} with gradient ms"] = least(lambda way=way: (way() * weights).sum().backward(), 5)
    return row


def relative(found: Tensor, truth: Tensor) -> float:
    """Largest difference over the largest value."""
    return float((found.double() - truth).abs().max() / truth.abs().max())


def settings_row(name: str, config: VolumetricConfig, scene: Scene) -> dict[str, Any]:
    """Held-out PSNR of a plain field, milliseconds of processor time a step, and its size."""
    with tempfile.TemporaryDirectory() as folder:
        start = time.process_time()
        model = train(scene, config, 0, Path(folder), lambda space, g, _: RadianceModel(config, space, g)).model
        seconds = time.process_time() - start
    reasons: dict[str, str] = {}
    scores = [score_image(model.render(view.camera), view, reasons, METRICS[:1])["psnr"] for view in scene.test_views]
    parameters = sum(parameter.numel() for parameter in model.parameters())
    return {
        "changed": name,
        "PSNR": np.mean(scores),
        "step ms": 1000 * seconds / config.iterations,
        "parameters": parameters,
    }
