"""What tests that train or render start with; a conftest imports these."""

import numba
import pytest
import torch

from baselines.splatting.backends.warm_up import warm_up


@pytest.fixture(scope="session", autouse=True)
def compiled_kernels():
    """Compiled as a run compiles them, by a process of their own: code fresh from the compiler rounds differently."""
    warm_up(3)


@pytest.fixture(autouse=True)
def one_thread():
    """Tiny scenes on a busy machine: threads would wait for each other most of the time."""
    before = numba.get_num_threads()
    numba.set_num_threads(1)
    yield
    numba.set_num_threads(before)


@pytest.fixture(autouse=True)
def one_torch_thread():
    """The same of torch's threads."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)
