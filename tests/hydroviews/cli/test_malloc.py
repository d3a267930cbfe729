"""Blocks that are freed and asked for again; in processes of their own, as it is a setting of the whole process."""

import platform
import subprocess
import sys

import pytest

FAULTS = """
import resource, sys
import numpy as np
from hydroviews.cli.malloc import keep_freed_memory
if sys.argv[1] == "keep":
    assert keep_freed_memory()
def faults():
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt
np.ones(5_000_000)
before = faults()
for _ in range(5):
    np.ones(5_000_000)
print(faults() - before)
"""


def faults(how: str) -> int:
    process = subprocess.run([sys.executable, "-c", FAULTS, how], capture_output=True, text=True, check=True)
    return int(process.stdout)


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="other C libraries are left as they are")
def test_freed_blocks_are_not_cleared_by_the_system_again():
    assert faults("keep") < faults("default") / 5
