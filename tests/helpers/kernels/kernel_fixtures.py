"""What tests that train or render start with; a conftest imports these."""

from collections.abc import Iterator
from contextlib import contextmanager

import numba
import pytest
import torch

from baselines.splatting.backends.warm_up import warm_up


@pytest.fixture(scope="session", autouse=True)
def compiled_kernels():
    """Compiled as a run compiles them, by a process of their own: code fresh from the compiler rounds differently."""
    warm_up(3)


@contextmanager
def single_threaded() -> Iterator[None]:
    """Tiny scenes on a busy machine: threads would wait for each other most of the time."""
    before = numba.get_num_threads(), torch.get_num_threads()
    numba.set_num_threads(1)
    torch.set_num_threads(1)
    try:
        yield
    finally:
        numba.set_num_threads(before[0])
        torch.set_num_threads(before[1])


@pytest.fixture(scope="module", autouse=True)
def one_thread_for_what_is_shared():
    """What the tests of a module share is made before the fixtures of any one test."""
    with single_threaded():
        yield


@pytest.fixture(autouse=True)
def one_thread():
    """Whatever the test before has left."""
    with single_threaded():
        yield
