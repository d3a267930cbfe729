"""Torch keeps to its number of threads, on which its last bits depend."""

import os
import subprocess
import sys

CODE = """
import torch
from baselines.training.torch_state import one_thread

with one_thread():
    import numba

    @numba.njit(parallel=True)
    def count(n):
        total = 0
        for i in numba.prange(n):
            total += i
        return total

    assert count(10) == 45
    print(torch.get_num_threads())
"""


def test_threads_that_numba_starts_leave_torch_with_one():
    environment = {**os.environ, "NUMBA_NUM_THREADS": "2", "OMP_NUM_THREADS": "2"}
    found = subprocess.run([sys.executable, "-c", CODE], env=environment, capture_output=True, text=True, check=True)
    assert found.stdout.split() == ["1"]
