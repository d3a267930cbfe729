"""Results on one thread and on two."""

import numba
import numpy as np
import pytest


def assert_same_on_two_threads(compute):
    """The numbers and arrays that a function returns are the same to the bit."""
    if numba.config.NUMBA_NUM_THREADS < 2:
        pytest.skip("needs two threads")
    results = []
    for threads in (1, 2):
        numba.set_num_threads(threads)
        results.append([np.asarray(values).tobytes() for values in compute()])
    assert results[0] == results[1]
