"""What a run costs beside its training, in processor seconds: metrics, and a run of a method that learns nothing.

python -m benchmarks.evaluation --data data
"""

import os
import tempfile
from pathlib import Path

import numpy as np

from baselines.method import Method, TrainingSummary
from benchmarks.timing import least
from hydroviews.cli.commands import run_command
from hydroviews.metrics import find_metrics
from leaderboard.evaluate import carry_out
from leaderboard.runs.run import Run
from leaderboard.runs.supervision import Limits
from leaderboard.scoring.score import score

NAME = "benchmarks.evaluation:_Grey"


class _Grey(Method):
    configuration = classmethod(lambda kind, profile: TrainingSummary(0, None, 0, "cpu"))
    load = classmethod(lambda kind, config, seed, folder: kind(config, seed))

    def fit(self, scene, folder): ...

    def render(self, camera):
        return np.full((camera.height, camera.width, 3), 0.5, np.float32)

    def save(self, folder): ...

    def summary(self):
        return TrainingSummary(train_seconds=0, n_primitives=None, model_mb=0, device="cpu")


def _seconds() -> float:
    """Processor seconds of this process and those that it has waited for."""
    return sum(os.times()[:4])


def main(data: Path = Path("data")) -> None:
    """Measure on random pictures, and two runs on courtyard, which has to be built."""
    first, second = np.random.default_rng(0).random((2, 300, 400, 3), np.float32)
    for metric in find_metrics():
        print(f"{metric.name}: {least(lambda: metric.function(first, second), 3):.0f} ms a view of 400x300")  # noqa: B023
    with tempfile.TemporaryDirectory(prefix="hydroviews-", dir=".") as results:
        for pattern in ("raindrop-1", "streak-1"):
            run = Run(NAME, "demo", 0, data.resolve(), "courtyard", pattern, Path(results).resolve())
            start = _seconds()
            carry_out(run, Limits(time=1, stall=1))
            end = _seconds()
            score(run)
            n_views = len(run.clean_scene().test_views)
            print(f"{pattern}: {end - start:.1f} s, of them {_seconds() - end:.1f} s scoring {n_views} views")


if __name__ == "__main__":
    run_command(main, prog="benchmarks.evaluation")
