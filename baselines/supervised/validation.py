"""Validation of networks on pictures in known rain: measured one by one, summed up by kind."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm


class ValidationPicture(Protocol):
    """A picture in known rain."""

    @property
    def kind(self) -> str:
        """Such as streak-medium; or clean."""


P = TypeVar("P", bound=ValidationPicture)
R = TypeVar("R")


def measure_by_kind(pictures: Iterable[P], measure: Callable[[P], R]) -> dict[str, list[R]]:
    """What `measure` finds on every picture, by kind, showing progress."""
    rows: dict[str, list[R]] = {}
    for picture in tqdm(pictures, desc="validation", unit="picture", leave=False):
        rows.setdefault(picture.kind, []).append(measure(picture))
    return rows


def average_precision(found: NDArray, truth: NDArray) -> float:
    """Area under the curve of precision over recall, in steps; what is found equally strongly is taken together.

    Args:
        found: [N], higher where more certain.
        truth: bool [N], at least one true.

    Raises:
        ValueError: nothing is true.
    """
    if not truth.any():
        raise ValueError("average precision of nothing to be found")
    order = np.argsort(-found, kind="stable")
    sorted_found, hits = found[order], np.cumsum(truth[order])
    last = np.append(np.flatnonzero(np.diff(sorted_found)), len(found) - 1)  # of those found equally strongly
    precision, recall = hits[last] / (last + 1), hits[last] / hits[-1]
    return float(np.sum(np.diff(recall, prepend=0.0) * precision))


def as_json(scores: Sequence[Any], decimals: int) -> list[dict[str, str | int | float | None]]:
    """Scores, which are dataclasses, for a data card; what is not finite is left empty."""
    finite = lambda v: round(v, decimals) if np.isfinite(v) else None  # noqa: E731
    return [{k: finite(v) if isinstance(v, float) else v for k, v in asdict(score).items()} for score in scores]
