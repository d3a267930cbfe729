"""How well drops of held-out photographs are found and removed."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from baselines.derain_nerf.raindrop_attention.detection import detect
from baselines.derain_nerf.raindrop_attention.network import DerainGenerator
from baselines.derain_nerf.raindrop_attention.pairs import ValidationPicture
from baselines.supervised.validation import average_precision, measure_by_kind
from hydroviews.formats.tables.markdown import markdown_table
from hydroviews.metrics import psnr

COVERED = 0.5  # a pixel is a drop's from this cover on
THRESHOLD = 0.5  # and taken for one from this attention on


@dataclass(frozen=True)
class Score:
    """Of all pictures of a kind; NaN where there are no drops, infinite where clean is compared with clean."""

    kind: str
    pictures: int
    precision: float  # average precision of the attention, over all pixels
    overlap: float  # intersection over union at the threshold
    flagged: float  # share of the pixels taken for drops
    before: float  # mean PSNR of the rainy pictures, dB
    after: float  # and of the derained ones


def scores(generator: DerainGenerator, pictures: Sequence[ValidationPicture]) -> list[Score]:
    """How a generator does, a row a kind."""

    def measure(picture: ValidationPicture) -> _Row:
        found = detect(picture.rainy, generator)
        before, after = (float(psnr(image, picture.clean)) for image in (picture.rainy, found.derained))
        return _Row(found.attention.ravel(), picture.cover.ravel() >= COVERED, before, after)

    return [_score(kind, rows) for kind, rows in measure_by_kind(pictures, measure).items()]


class _Row(NamedTuple):
    attention: NDArray[np.float32]
    truth: NDArray[np.bool_]
    before: float
    after: float


def _score(kind: str, rows: Sequence[_Row]) -> Score:
    attention, truth = np.concatenate([row.attention for row in rows]), np.concatenate([row.truth for row in rows])
    flagged = attention >= THRESHOLD
    overlap = float((flagged & truth).sum() / (flagged | truth).sum()) if truth.any() else np.nan
    precision = average_precision(attention, truth) if truth.any() else np.nan
    before, after = (float(np.mean(v)) for v in ([row.before for row in rows], [row.after for row in rows]))
    return Score(kind, len(rows), precision, overlap, float(flagged.mean()), before, after)


def as_columns(rows: Sequence[Score]) -> dict[str, float]:
    """For a row of a training curve; what there is none of is left out."""
    columns: dict[str, float] = {}
    for row in rows:
        values = {"AP": row.precision, "IoU": row.overlap, "flagged": row.flagged, "gain": row.after - row.before}
        values = values if np.isfinite(row.before) else {**values, "gain": np.nan, "PSNR": row.after}
        columns |= {f"{row.kind} {name}": value for name, value in values.items() if np.isfinite(value)}
    return columns


def table(rows: Sequence[Score]) -> str:
    """Markdown."""
    cells = []
    number = lambda v, form: format(v, form) if np.isfinite(v) else ""  # noqa: E731
    for row in rows:
        quality = [number(row.precision, ".3f"), number(row.overlap, ".3f"), f"{row.flagged:.1%}"]
        cells.append((row.kind, row.pictures, *quality, number(row.before, ".2f"), number(row.after, ".2f")))
    head = ("rain", "pictures", "AP", "IoU", "taken for drops", "PSNR before", "after")
    return markdown_table(head, cells, keep_empty=True)
