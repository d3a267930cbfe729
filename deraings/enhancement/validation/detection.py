"""How well the cover by drops or by streaks is found."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from baselines.supervised.validation import average_precision
from deraings.image_planes import Plane


class Detection(NamedTuple):
    """How well a cover is found; NaN where there is nothing to be found."""

    average_precision: float
    precision: float  # NaN also where nothing is taken for covered
    recall: float


def detection(found: Sequence[Plane | None], true: Sequence[Plane | None], threshold: float) -> Detection:
    """How well covers of pictures are found, over the pixels of all of them.

    Args:
        found: covers [H, W] in [0, 1]; None where there is none.
        true: the same of the same pictures; pictures with None in either do not count.
        threshold: cover above which a pixel is covered, in the truth, and for precision and recall in what is found.
    """
    both = [(f.ravel(), t.ravel()) for f, t in zip(found, true, strict=True) if f is not None and t is not None]
    cover, truth = (np.concatenate(planes) for planes in zip(*both, strict=True)) if both else (np.zeros(0),) * 2
    covered: NDArray[np.bool_] = truth > threshold
    if not covered.any():
        return Detection(np.nan, np.nan, np.nan)
    flagged = cover > threshold
    hits = float(np.sum(flagged & covered))
    precision = hits / float(flagged.sum()) if flagged.any() else np.nan
    return Detection(average_precision(cover, covered), precision, hits / float(covered.sum()))
