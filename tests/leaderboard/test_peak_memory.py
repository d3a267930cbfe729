import subprocess
import sys

import numpy as np

COMMAND = "from leaderboard.predict import peak_memory_mb; print(peak_memory_mb())"


def test_memory_is_the_processs_own():
    ballast = np.ones(300_000_000, np.uint8)  # of a parent that is larger than its child
    found = float(subprocess.run([sys.executable, "-c", COMMAND], check=True, capture_output=True, text=True).stdout)
    assert ballast[0] == 1
    large = f"import numpy; ballast = numpy.ones(500_000_000, numpy.uint8); {COMMAND}"
    more = float(subprocess.run([sys.executable, "-c", large], check=True, capture_output=True, text=True).stdout)
    assert 450 < more - found < 550
