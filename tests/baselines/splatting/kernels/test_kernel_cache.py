"""The first training of all, which compiles the kernels, must not differ from any later one."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

from baselines.splatting.backends.warm_up import warm_up
from baselines.splatting.kernels.jit import FOLDER

TESTS = Path(__file__).parents[3]
HELPERS = TESTS / "helpers"
FRESH = "blending_gradient.blend_gradient-*"  # rounds differently, fresh from the compiler and from the cache
TRAIN = """
import hashlib, sys
from dataclasses import replace
from pathlib import Path
sys.path[:0] = sys.argv[2:]
from splats import photographed
from trainings import CONFIG
from baselines.splatting.gaussians import FIELDS
from baselines.splatting.trainer import train
folder = Path(sys.argv[1])
scene = photographed(folder / "scene", 4, 24, 16)
gaussians = train(scene, replace(CONFIG, iterations=60), 0, folder / "run").gaussians
print(hashlib.sha256(b"".join(getattr(gaussians, name).tobytes() for name in FIELDS)).hexdigest())
"""


def trained(folder: Path, cache: Path) -> subprocess.CompletedProcess:
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache), "NUMBA_NUM_THREADS": "1"}
    places = HELPERS / "scenes", HELPERS / "trainings", TESTS.parent
    command = [sys.executable, "-c", TRAIN, str(folder), *map(str, places)]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=True)


def test_kernels_that_are_not_in_the_cache_give_the_same_bits(tmp_path):
    """Of one kernel: to compile all of them takes a minute or two, and most round the same way both times."""
    warm_up(1)
    cache = tmp_path / "cache" / Path(FOLDER).name
    shutil.copytree(FOLDER, cache, ignore=shutil.ignore_patterns(FRESH, "compiled-*", "*.tmp.*"))
    first = trained(tmp_path / "first", cache.parent)
    assert list(cache.rglob(FRESH))
    later = trained(tmp_path / "later", cache.parent)
    assert ["compiling the kernels" in run.stderr for run in (first, later)] == [True, False]
    assert len(first.stdout.strip()) == 64
    assert first.stdout == later.stdout
