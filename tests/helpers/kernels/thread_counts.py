"""Results on one thread and on two."""

from collections.abc import Callable, Iterable

import numba
import numpy as np
import pytest
from numpy.typing import ArrayLike


def assert_same_on_two_threads(compute: Callable[[], Iterable[ArrayLike]]) -> None:
    """The numbers and arrays that a function returns are the same to the bit."""
    if numba.config.NUMBA_NUM_THREADS < 2:
        pytest.skip("needs two threads")
    results = []
    for threads in (1, 2):
        numba.set_num_threads(threads)
        results.append([np.asarray(values).tobytes() for values in compute()])
    assert results[0] == results[1]
