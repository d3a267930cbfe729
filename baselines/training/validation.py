"""Validation of networks on pictures in known rain: measured one by one, summed up by kind."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict
from typing import Any, Protocol, TypeVar

import numpy as np
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


def as_json(scores: Sequence[Any], decimals: int) -> list[dict[str, str | int | float | None]]:
    """Scores, which are dataclasses, for a data card; what is not finite is left empty."""
    finite = lambda v: round(v, decimals) if np.isfinite(v) else None  # noqa: E731
    return [{k: finite(v) if isinstance(v, float) else v for k, v in asdict(score).items()} for score in scores]
