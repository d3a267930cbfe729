"""The course of a run's training, drawn: its loss, and its number of primitives if it has one that changes."""

import csv
import logging
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from baselines.training.learning_curve import LEARNING_CURVE
from leaderboard.site.axes import Ticks, across, ticks, up, widened

logger = logging.getLogger(__name__)

SECONDS = "seconds"
APART = ("step", SECONDS)  # columns that are not drawn


@dataclass(frozen=True)
class Curve:
    """A drawing of a number over the seconds of a training."""

    name: str
    points: str  # for `<polyline>`
    told: str
    x_ticks: Ticks
    y_ticks: Ticks


def learning_curves(folder: Path) -> list[Curve]:
    """A drawing a column of the learning curve in a run's folder; none where there is no such file or no two rows.

    A file that is damaged is passed over with a warning.
    """
    path = folder / LEARNING_CURVE
    if not path.is_file():
        return []
    try:
        columns, *rows = csv.reader(path.read_text(encoding="utf-8").splitlines())
        numbers = np.array(rows, float).reshape(len(rows), len(columns))
        seconds = numbers[:, columns.index(SECONDS)]
    except FileNotFoundError:  # removed meanwhile, with its run
        return []
    except (ValueError, csv.Error) as error:  # also text that is none, no row at all, a column that is missing
        logger.warning("%s: not drawn: %s", path, error)
        return []
    known = np.isfinite(numbers) & np.isfinite(seconds)[:, None]
    drawn = {name: (seconds[k], column[k]) for name, column, k in zip(columns, numbers.T, known.T, strict=True)}
    return [draw(name, *curve) for name, curve in drawn.items() if name not in APART and len(curve[0]) > 1]


def draw(name: str, seconds: NDArray[np.float64], numbers: NDArray[np.float64]) -> Curve:
    """The drawing of two or more finite numbers, by seconds of training, which rise."""
    right, upwards = (0.0, max(seconds[-1], 1e-6)), widened(numbers.min(), numbers.max(), 0.05)
    return Curve(
        name=name,
        points=" ".join(f"{across(x, right)},{up(y, upwards)}" for x, y in zip(seconds, numbers, strict=True)),
        told=f"{numbers[0]:.4g} at first, {numbers[-1]:.4g} after {seconds[-1]:.4g} s",
        x_ticks=tuple((across(value, right), f"{value:g}") for value in ticks(*right)),
        y_ticks=tuple((up(value, upwards), f"{value:g}") for value in ticks(*upwards)),
    )
