"""The learning curve of a training: mean losses in about a hundred rows, as a table beside the checkpoint."""

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
    """Rows of steps done, seconds, each loss's mean since the row before, and each count as it is then.

    A mean is over the steps that had the loss, and nan where none had it.
    """

    def __init__(self, iterations: int) -> None:
        """Nothing known yet of a training of so many steps."""
        self._every = max(1, math.ceil(iterations / ROWS))
        self.columns = ["step", "seconds"]
        self.rows: list[list[float]] = []
        self._sums: dict[str, float] = {}  # of the steps since the last row
        self._steps: dict[str, int] = {}  # that had the loss; a count is that of the last one

    def add(self, done: int, seconds: float, metrics: Mapping[str, float], last: bool) -> None:
        """Take in a step.

        Args:
            done: steps, with this one.
            seconds: of training, over all sessions.
            metrics: losses, as floats, and counts, as integers; names may be missing in a step, or come later.
            last: whether no step is left, which makes a row.
        """
        for name, value in metrics.items():
            known = 0 if isinstance(value, int) else self._steps.get(name, 0)
            self._sums[name] = self._sums[name] + value if known else value
            self._steps[name] = known + 1
        if done % self._every == 0 or last:
            self.columns += [name for name in self._sums if name not in self.columns]
            means = {name: total / self._steps[name] for name, total in self._sums.items()}
            self.rows.append([done, seconds, *(means.get(name, math.nan) for name in self.columns[2:])])
            for row in self.rows:
                row += [math.nan] * (len(self.columns) - len(row))
            self._sums, self._steps = {}, {}

    def state_dict(self) -> Tree:
        """All of it, for a checkpoint."""
        return {"columns": self.columns, "rows": self.rows, "sums": self._sums, "steps": self._steps}

    def load_state_dict(self, tree: Tree) -> None:
        """Take over what `state_dict` gave."""
        self.columns, self.rows, self._sums = tree["columns"] or self.columns, tree["rows"], tree["sums"]
        steps: int | dict[str, int] = tree["steps"]
        self._steps = steps if isinstance(steps, dict) else dict.fromkeys(self._sums, steps)  # older ones have a number


def write_rows(path: Path, columns: Sequence[str], rows: Iterable[Sequence[float]]) -> None:
    """Write rows of numbers as a CSV, of six digits each."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows([f"{value:.6g}" for value in row] for row in rows)
    write_bytes(path, text.getvalue().encode())
