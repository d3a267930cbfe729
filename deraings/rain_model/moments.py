"""Moments of the film that the views are, for what changes slowly on the lens."""

import numpy as np
from numpy.typing import NDArray


def moments_of(n_views: int, views_a_moment: int, most: int) -> int:
    """How many moments of a film of so many views are told apart."""
    return int(np.clip(n_views // views_a_moment, 1, most))


def moment_weights(view: int, n_views: int, moments: int) -> NDArray[np.float32]:
    """Shares [T] of the moments in a view: hat functions over the film, 1 in all."""
    time = view / max(n_views - 1, 1) * (moments - 1)
    return np.maximum(0, 1 - np.abs(np.arange(moments) - time)).astype(np.float32)
