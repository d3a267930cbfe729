"""What a run costs beside its training, in processor seconds: metrics, and a run of a method that learns nothing.

python -m benchmarks.evaluation --data data
"""

import os
import tempfile
from functools import partial
from pathlib import Path
from typing import Any, Self

import numpy as np

from baselines.method import Method, TrainingSummary
from benchmarks.timing import least
from hydroviews.cli.commands import run_command
from hydroviews.metrics import find_metrics
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import Image
from hydroviews.scene.scenes import Scene
from leaderboard.evaluate import carry_out
from leaderboard.runs.run import Run
from leaderboard.runs.supervision import Limits
from leaderboard.scoring.score import score

NOTHING = TrainingSummary(train_seconds=0, n_primitives=None, model_mb=0, device="cpu")


class Grey(Method):
    """Renders a grey picture of every view, and learns nothing."""

    @classmethod
    def configuration(cls, profile: str) -> TrainingSummary:
        """See Method; any dataclass will do."""
        return NOTHING

    @classmethod
    def load(cls, config: Any, seed: int, folder: Path) -> Self:
        """See Method."""
        return cls(config, seed)

    def fit(self, scene: Scene, folder: Path) -> None:
        """See Method."""

    def render(self, camera: Camera) -> Image:
        """See Method."""
        return np.full((camera.height, camera.width, 3), 0.5, np.float32)

    def save(self, folder: Path) -> None:
        """See Method."""

    def summary(self) -> TrainingSummary:
        """See Method."""
        return NOTHING


def _seconds() -> float:
    """Processor seconds of this process and those that it has waited for."""
    return sum(os.times()[:4])


def main(data: Path = Path("data")) -> None:
    """Measure on random pictures, and two runs on courtyard, which has to be built."""
    first, second = np.random.default_rng(0).random((2, 300, 400, 3), np.float32)
    for metric in find_metrics():
        took = least(partial(metric.function, first, second), 3)
        print(f"{metric.name}: {took:.0f} ms a view of 400x300")
    with tempfile.TemporaryDirectory(prefix="hydroviews-", dir=".") as results:
        for pattern in ("raindrop-1", "streak-1"):
            run = Run(
                "benchmarks.evaluation:Grey", "demo", 0, data.resolve(), "courtyard", pattern, Path(results).resolve()
            )
            start = _seconds()
            carry_out(run, Limits(time=1, stall=1))
            end = _seconds()
            score(run)
            n_views = len(run.clean_scene().test_views)
            print(f"{pattern}: {end - start:.1f} s, of them {_seconds() - end:.1f} s scoring {n_views} views")


if __name__ == "__main__":
    run_command(main, prog="benchmarks.evaluation")
