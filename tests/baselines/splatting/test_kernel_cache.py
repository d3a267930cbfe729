"""The first training of all, which compiles the kernels, must not differ from any later one."""

import os
import subprocess
import sys
from pathlib import Path

TESTS = Path(__file__).parents[2]
TRAIN = """
import hashlib, sys
from dataclasses import replace
from pathlib import Path
sys.path[:0] = sys.argv[1:3]
from splats import photographed
from trainings import CONFIG
from baselines.splatting.gaussians import FIELDS
from baselines.splatting.trainer import train
folder = Path(sys.argv[3])
scene = photographed(folder / "scene", 4, 24, 16)
gaussians = train(scene, replace(CONFIG, iterations=60), 0, folder / "run").gaussians
print(hashlib.sha256(b"".join(getattr(gaussians, name).tobytes() for name in FIELDS)).hexdigest())
"""


def trained(folder: Path, cache: Path) -> subprocess.CompletedProcess:
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache), "NUMBA_NUM_THREADS": "1"}
    command = [sys.executable, "-c", TRAIN, str(TESTS / "helpers"), str(TESTS.parent), str(folder)]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=True)


def test_an_empty_cache_gives_the_same_bits(tmp_path):
    first = trained(tmp_path / "first", tmp_path / "cache")
    later = trained(tmp_path / "later", tmp_path / "cache")
    assert "compiling the kernels" in first.stderr
    assert "compiling the kernels" not in later.stderr
    assert len(first.stdout.strip()) == 64
    assert first.stdout == later.stdout
