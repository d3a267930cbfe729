"""A metric of one's own, in one file."""

import numpy as np

from hydroviews.metrics import Metric


def largest_error(image, target, ignored=None) -> float:
    return float(np.abs(image - target).max())


LARGEST_ERROR = Metric("largest_error", "largest error", 3, higher_is_better=False, function=largest_error)
BROKEN = "no metric"
