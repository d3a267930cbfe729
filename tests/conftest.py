import os
import random
import signal
import sys
from pathlib import Path

import pytest

# Files and folders in the order they begin in: what takes long first, so that no process waits for the last of it.
ORDER = (
    "baselines/splatting/kernels/test_kernel_cache.py",  # first compiles the kernels, which methods' tests wait for
    "hydroviews/blender",  # needs none
    "hydroviews/captures/sfm/test_poses.py",
    "hydroviews/rain/lens/test_renewed_build.py",
    "test_interruptions.py",
    "baselines/training/test_kills.py",
    "baselines/splatting/kernels/test_projection.py",
    "baselines/splatting/backends/test_triton_ops.py",
    "leaderboard/contract/test_every_method.py",  # trains every method a dozen times
    "leaderboard",
    "deraings",
    "baselines",
    "",  # all others
)

# What is promised to the bit is promised on the CPU; tests of a GPU say so themselves.
os.environ.setdefault("HYDROVIEWS_DEVICE", "cpu")

# There are more test processes than cores: threads that have nothing to do sleep, and numpy's products have one.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# Not tests/ itself: it has folders named like the packages.
sys.path[:0] = sorted(str(folder) for folder in (Path(__file__).parent / "helpers").iterdir() if folder.is_dir())

# Background jobs of a shell start with Ctrl-C ignored, and so would every process that a test starts and interrupts.
signal.signal(signal.SIGINT, signal.default_int_handler)

# Tests start hundreds of processes: what one has compiled of Python, the next ones read.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False


def pytest_xdist_auto_num_workers() -> int:
    """Processes for `-n auto`: half as many again as cores, since tests wait for processes that they start."""
    return round(1.5 * len(os.sched_getaffinity(0)))


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    items.sort(key=lambda item: _place(item.nodeid.removeprefix("tests/")))


def _place(test: str) -> int:
    """The place of a test's file in ORDER."""
    return next(i for i, start in enumerate(ORDER) if test.startswith(start))


@pytest.hookimpl(tryfirst=True)
def pytest_fixture_setup(fixturedef: object, request: pytest.FixtureRequest) -> None:
    """A fixture without a generator of its own draws the same numbers whatever was drawn before."""
    _seed()


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_call(item: pytest.Item) -> None:
    """Nor does what a test draws, such as first weights of networks: tests pass in any order."""
    _seed()


def _seed() -> None:
    random.seed(0)
    if numpy := sys.modules.get("numpy"):  # not imported here: above are settings that it reads when it is
        numpy.random.seed(0)
    if torch := sys.modules.get("torch"):
        torch.manual_seed(0)  # by itself torch begins with another seed in every process
