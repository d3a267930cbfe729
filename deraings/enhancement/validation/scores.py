"""Errors of a network on held-out photographs in known rain: mist first, then cover, then PSNR.

* Mist: its predicted planes are taken off the clean photograph behind the true mist alone. The rest is their error.
* Drops and streaks: average precision, precision and recall of the predicted cover, over all pixels of a kind.
* The picture: PSNR before and after, the error of its brightness, and how well the network predicts its own error.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.stats import spearmanr

from baselines.supervised.validation import measure_by_kind
from deraings.enhancement.architecture.lenses import Lens, lenses_of_capture
from deraings.enhancement.architecture.network import EnhancementNetwork
from deraings.enhancement.clear_pixels import DROPS, STREAKS
from deraings.enhancement.enhance import Enhanced, mist_on_lens, predict, without_mist
from deraings.enhancement.validation.calibration import Curve, calibration
from deraings.enhancement.validation.detection import detection
from deraings.enhancement.validation.pictures import ValidationPicture
from deraings.enhancement.weights import Enhancer
from deraings.image_planes import Plane
from deraings.lens.views import AROUND, mean_around
from hydroviews.formats.tables.markdown import markdown_table
from hydroviews.metrics import psnr
from hydroviews.scene.images import Image, to_uint8

DROP = 0.5  # cover from which a pixel is a drop's, and is taken for one
# The same of streaks. Even heavy ones hardly reach 0.5, which 2 % of the pixels do at most, and 0.1 % in light ones.
# 0.3 is reached by 2 % of the pixels in light ones, 4 % in medium ones and 10 to 20 % in heavy ones.
STREAK = 0.3
RANKED = 3  # every so many rows and columns are ranked
VIEWS = 4  # companions, at most, that a mean cover is of: predicting theirs takes longer than all the rest


@dataclass(frozen=True)
class Score:
    """Scores over the pictures of a kind; NaN where the truth is unknown or nothing is to be found.

    PSNR is in dB and a mean over pictures, infinite where a picture is the clean one. Average precision, precision and
    recall are of all pixels of all pictures, in [0, 1].
    """

    kind: str
    pictures: int
    misted: float  # PSNR of clean pictures behind the true mist alone
    planes: float  # PSNR of the same, after the predicted mist is taken off
    drops: float  # average precision of the cover by drops
    drops_precision: float  # at DROP
    drops_recall: float
    drops_over_views: float  # average precision of the mean cover of companions, where drops stay on the lens
    streaks: float  # average precision of the cover by streaks
    streaks_precision: float  # at STREAK
    streaks_recall: float
    before: float  # PSNR of the rainy pictures
    after: float  # PSNR of the enhanced ones
    brightness: float  # mean over pictures of |mean(enhanced) - mean(clean)|, in 1/255
    error_rank: float  # mean over pictures of the rank correlation of predicted and true error
    error_ratio: float  # mean over pictures of true over predicted mean error
    calibration: Curve | None  # predicted and true error of tenths of the pixels; None where no error is predicted


class _Row(NamedTuple):
    """Of one picture."""

    numbers: tuple[float, ...]  # misted, planes, before, after, brightness: see Score
    enhanced: Enhanced
    over_views: Plane | None  # mean cover by drops [H, W]
    picture: ValidationPicture


def scores(
    network: EnhancementNetwork, pictures: Sequence[ValidationPicture], companions: int = 0, views: int = VIEWS
) -> list[Score]:
    """How a network does, a row a kind.

    Args:
        network: what is judged.
        pictures: from `validation_set`.
        companions: how many photographs of the same lens the network is given with each, at most.
        views: companions of which the cover is predicted for a mean cover; 0 for no mean, which saves time.
    """
    enhancer = Enhancer(network, {}, "being validated")
    rows = measure_by_kind(pictures, lambda picture: _measure(picture, enhancer, companions, views))
    return [_score(kind, row) for kind, row in rows.items()]


def scores_by_companions(
    network: EnhancementNetwork, pictures: Sequence[ValidationPicture], counts: Sequence[int]
) -> dict[int, list[Score]]:
    """`scores` with each number of companions; mean covers, which take long, with the largest number alone."""
    return {count: scores(network, pictures, count, VIEWS if count == max(counts) else 0) for count in counts}


def _measure(picture: ValidationPicture, enhancer: Enhancer, companions: int, views: int) -> _Row:
    network, others = enhancer.network, picture.companions[:companions]
    together = [to_uint8(picture.rainy), *others]
    (lens, *_) = lenses_of_capture(len(together), together.__getitem__, network)
    enhanced = predict(picture.rainy, enhancer, lens=lens)
    brightness = 255 * abs(float(enhanced.picture.mean(dtype=np.float64) - picture.clean.mean(dtype=np.float64)))
    before, after = (float(psnr(image, picture.clean)) for image in (picture.rainy, enhanced.picture))
    numbers = (*mist_errors(picture, network, lens), before, after, brightness)
    looked_at = others[: views if picture.drops is not None and network.config.cover else 0]
    covers = [predict(other.astype(np.float32) / 255, enhancer, lens=lens).cover for other in looked_at]
    return _Row(numbers, enhanced, cover_over_views([cover for cover in covers if cover is not None]), picture)


def mist_errors(picture: ValidationPicture, network: EnhancementNetwork, lens: Lens | None) -> tuple[float, float]:
    """PSNR, in dB, of the clean picture behind the true mist alone, and after the predicted mist is taken off.

    The mist is predicted from the rainy picture. Errors of drops and streaks do not count, nor does what the rest of
    the network mends. Both are NaN where the true mist is not known.
    """
    if picture.mist is None:
        return np.nan, np.nan
    misted = picture.mist.over(picture.clean)
    left = without_mist(misted, mist_on_lens(picture.rainy, network, lens))
    return float(psnr(misted, picture.clean)), float(psnr(np.clip(left, 0, 1), picture.clean))


def cover_over_views(covers: Sequence[Image]) -> Plane | None:
    """The mean cover by drops [H, W] of the views before and after one, as `clear_pixels` averages them in use.

    Args:
        covers: what rain covers of each [H, W, 3], [0, 1], in the order of the views.

    Returns:
        None where there is no other view.
    """
    drops = {view: np.ascontiguousarray(cover[..., DROPS]) for view, cover in enumerate(covers, start=1)}
    return mean_around(0, drops, drops[1].shape, AROUND) if drops else None


def _score(kind: str, rows: Sequence[_Row]) -> Score:
    misted, planes, before, after, brightness = np.mean([row.numbers for row in rows], axis=0).tolist()
    true_drops, true_streaks = [row.picture.drops for row in rows], [row.picture.streaks for row in rows]
    covers = [row.enhanced.cover for row in rows]
    drops = detection([None if cover is None else cover[..., DROPS] for cover in covers], true_drops, DROP)
    streaks = detection([None if cover is None else cover[..., STREAKS] for cover in covers], true_streaks, STREAK)
    over_views = detection([row.over_views for row in rows], true_drops, DROP).average_precision
    rank, ratio = np.mean([doubt(row.enhanced, row.picture.clean) for row in rows], axis=0).tolist()
    picture = before, after, brightness, rank, ratio
    return Score(kind, len(rows), misted, planes, *drops, over_views, *streaks, *picture, _calibration(rows))


def _calibration(rows: Sequence[_Row]) -> Curve | None:
    predicted = [row.enhanced.error for row in rows if row.enhanced.error is not None]
    true = [true_error(row.enhanced.picture, row.picture.clean) for row in rows]
    return calibration(predicted, true) if predicted else None


def true_error(picture: Image, clean: Image) -> Plane:
    """Means over channels of |picture - clean|, both [H, W, 3]: [H, W]."""
    return np.asarray(np.abs(picture - clean).mean(axis=2), np.float32)


def doubt(enhanced: Enhanced, clean: Image) -> tuple[float, float]:
    """How well a network predicts its own error: rank correlation over pixels, and true over predicted mean error.

    Both are NaN where no error is predicted. Errors are means over channels of |enhanced - clean|.

    Args:
        enhanced: what the network predicts.
        clean: [H, W, 3].
    """
    if enhanced.error is None:
        return np.nan, np.nan
    true = true_error(enhanced.picture, clean)
    correlation = spearmanr(enhanced.error[::RANKED, ::RANKED], true[::RANKED, ::RANKED], axis=None).statistic
    return float(correlation), float(true.mean() / enhanced.error.mean())


def as_columns(rows: Sequence[Score]) -> dict[str, float]:
    """For a row of a training curve: PSNR after by kind, and average precision of drops where there are any."""
    drops = {f"{row.kind} drops": row.drops for row in rows if np.isfinite(row.drops)}
    return {row.kind: row.after for row in rows} | drops


HEAD = (
    "rain",
    "pictures",
    "true mist alone, dB",
    "planes leave, dB",
    "drops AP",
    "precision",
    "recall",
    "AP over views",
    "streaks AP",
    "precision",
    "recall",
    "PSNR before",
    "after",
    "gain",
    "brightness error",
    "error rank",
    "true over predicted",
)


def table(rows: Sequence[Score]) -> str:
    """Markdown: planes, cover, then the picture. What nobody knows is left empty."""
    return markdown_table(HEAD, [_cells(row) for row in rows], keep_empty=True)


def _cells(row: Score) -> tuple[str | int, ...]:
    drops = row.drops, row.drops_precision, row.drops_recall, row.drops_over_views
    shares = (*drops, row.streaks, row.streaks_precision, row.streaks_recall)
    return (
        row.kind,
        row.pictures,
        _decibels(row.misted),
        _decibels(row.planes),
        *("" if np.isnan(share) else f"{share:.3f}" for share in shares),
        _decibels(row.before),
        _decibels(row.after),
        f"{row.after - row.before:+.2f}" if np.isfinite(row.before) else "",
        f"{row.brightness:.2f}/255",
        *("" if np.isnan(value) else f"{value:.2f}" for value in (row.error_rank, row.error_ratio)),
    )


def _decibels(value: float) -> str:
    """Two decimals; in words where pictures are the same, and nothing where nobody knows."""
    if np.isnan(value):
        return ""
    return "the same" if np.isinf(value) else f"{value:.2f}"
