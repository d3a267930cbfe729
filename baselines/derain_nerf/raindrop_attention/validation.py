"""How well drops of held-out photographs are found and removed."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from baselines.derain_nerf.raindrop_attention.detection import detect
from baselines.derain_nerf.raindrop_attention.network import Generator
from baselines.derain_nerf.raindrop_attention.pairs import Watched
from hydroviews.formats.markdown import markdown_table
from hydroviews.metrics import psnr

COVERED = 0.5  # a pixel is a drop's from this cover on
THRESHOLD = 0.5  # and said to be from this attention on


@dataclass(frozen=True)
class Score:
    """Of all pictures of a kind; NaN where there are no drops, infinite where clean is compared with clean."""

    kind: str
    pictures: int
    precision: float  # average precision of the attention, over all pixels
    overlap: float  # intersection over union at the threshold
    said: float  # share of the pixels said to be drops
    before: float  # mean PSNR of the rainy pictures, dB
    after: float  # and of the derained ones


def scores(generator: Generator, pictures: Sequence[Watched]) -> list[Score]:
    """How a generator does, a row a kind."""
    kinds: dict[str, list[_Row]] = {}
    for picture in tqdm(pictures, desc="validation", unit="picture", leave=False):
        found = detect(picture.rainy, generator)
        before, after = (float(psnr(image, picture.clean)) for image in (picture.rainy, found.derained))
        row = _Row(found.attention.ravel(), picture.cover.ravel() >= COVERED, before, after)
        kinds.setdefault(picture.kind, []).append(row)
    return [_score(kind, rows) for kind, rows in kinds.items()]


class _Row(NamedTuple):
    attention: NDArray[np.float32]
    truth: NDArray[np.bool_]
    before: float
    after: float


def _score(kind: str, rows: Sequence[_Row]) -> Score:
    attention, truth = np.concatenate([row.attention for row in rows]), np.concatenate([row.truth for row in rows])
    said = attention >= THRESHOLD
    overlap = float((said & truth).sum() / (said | truth).sum()) if truth.any() else np.nan
    precision = average_precision(attention, truth) if truth.any() else np.nan
    before, after = (float(np.mean(v)) for v in ([row.before for row in rows], [row.after for row in rows]))
    return Score(kind, len(rows), precision, overlap, float(said.mean()), before, after)


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


def as_columns(rows: Sequence[Score]) -> dict[str, float]:
    """For a row of a training curve; what there is none of is left out."""
    columns: dict[str, float] = {}
    for row in rows:
        values = {"AP": row.precision, "IoU": row.overlap, "said": row.said, "gain": row.after - row.before}
        values = values if np.isfinite(row.before) else {**values, "gain": np.nan, "PSNR": row.after}
        columns |= {f"{row.kind} {name}": value for name, value in values.items() if np.isfinite(value)}
    return columns


def as_json(rows: Sequence[Score]) -> list[dict[str, str | int | float | None]]:
    """For a data card; what is not finite is left empty."""
    finite = lambda v: round(v, 4) if np.isfinite(v) else None  # noqa: E731
    return [{k: finite(v) if isinstance(v, float) else v for k, v in asdict(row).items()} for row in rows]


def table(rows: Sequence[Score]) -> str:
    """Markdown."""
    cells = []
    number = lambda v, form: format(v, form) if np.isfinite(v) else ""  # noqa: E731
    for row in rows:
        quality = [number(row.precision, ".3f"), number(row.overlap, ".3f"), f"{row.said:.1%}"]
        cells.append((row.kind, row.pictures, *quality, number(row.before, ".2f"), number(row.after, ".2f")))
    head = ("rain", "pictures", "AP", "IoU", "said to be drops", "PSNR before", "after")
    return markdown_table(head, cells, keep_empty=True)
