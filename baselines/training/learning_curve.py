"""The course of a training: means of its losses, a hundred times in all, as a table beside the checkpoint."""

import csv
import io
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from baselines.training.checkpoints import Tree
from hydroviews.files.atomic import write_bytes

LEARNING_CURVE = "learning_curve.csv"
ROWS = 100  # of a training of full length


class LearningCurve:
    """Rows of steps done, seconds, each loss's mean since the row before, and each count as it is then."""

    def __init__(self, iterations: int) -> None:
        """Nothing known yet of a training of so many steps."""
        self._every = max(1, math.ceil(iterations / ROWS))
        self.columns: list[str] = []
        self.rows: list[list[float]] = []
        self._sums: dict[str, float] = {}  # of the steps since the last row
        self._steps = 0

    def add(self, done: int, seconds: float, metrics: Mapping[str, float], last: bool) -> None:
        """Take in a step.

        Args:
            done: steps, with this one.
            seconds: of training, over all sessions.
            metrics: losses, as floats, and counts, as integers; of the same names in all steps.
            last: whether no step is left, which makes a row.
        """
        self._steps += 1
        for name, value in metrics.items():
            self._sums[name] = self._sums.get(name, 0.0) + value
        if done % self._every == 0 or last:
            told = [
                value if isinstance(value, int) else self._sums[name] / self._steps for name, value in metrics.items()
            ]
            self.columns = ["step", "seconds", *metrics]
            self.rows.append([done, seconds, *told])
            self._sums, self._steps = {}, 0

    def state_dict(self) -> Tree:
        """All of it, for a checkpoint."""
        return {"columns": self.columns, "rows": self.rows, "sums": self._sums, "steps": self._steps}

    def load_state_dict(self, tree: Tree) -> None:
        """Take over what `state_dict` gave."""
        self.columns, self.rows, self._sums, self._steps = (tree[n] for n in ("columns", "rows", "sums", "steps"))


def write_rows(path: Path, columns: Sequence[str], rows: Iterable[Sequence[float]]) -> None:
    """Write rows of numbers as a CSV, of six digits each."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows([f"{value:.6g}" for value in row] for row in rows)
    write_bytes(path, text.getvalue().encode())
