"""Knots in the order of the views, between which what is on the lens changes steadily: drops grow and run, mist dries.

Views in order of name are taken one after another, so a view's place in that order stands for its time.
"""

import numpy as np
from numpy.typing import NDArray

VIEWS_PER_KNOT = 12  # that what is on the lens at one time is learned from; fewer views have fewer knots
MAX_KNOTS = 3


def count_time_knots(n_views: int) -> int:
    """How many knots so many views can tell apart, 1 to MAX_KNOTS."""
    return int(np.clip(n_views // VIEWS_PER_KNOT, 1, MAX_KNOTS))


def time_weights(view: int, n_views: int, n_knots: int) -> NDArray[np.float32]:
    """Weights [T] of the knots in a view, of sum 1: linear interpolation between the two nearest."""
    time = view / max(n_views - 1, 1) * (n_knots - 1)
    return np.maximum(0, 1 - np.abs(np.arange(n_knots) - time)).astype(np.float32)


def views_near(knot: int, n_views: int, n_knots: int) -> list[int]:
    """The views in which a knot weighs at least a half, in order."""
    return [view for view in range(n_views) if time_weights(view, n_views, n_knots)[knot] >= 0.5]
