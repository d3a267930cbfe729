"""A training whose process is killed at random moments and goes on ends with the same bits."""

import os
import random
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from splats import photographed
from trainings import BUDGETED, CONFIG, assert_identical

from baselines.splatting.config import Pruning
from baselines.splatting.trainer import train

SEED = 20  # of the moments
STRATEGIES = {
    "densification": replace(CONFIG, resolutions=((0.3, 2),)),
    "relocation": replace(BUDGETED, pruning=Pruning(at=(0.5,), share=0.1)),
}
KILLED = """
import os, signal, sys, threading
sys.path[:0] = sys.argv[3:]
from dataclasses import replace
from pathlib import Path
from splats import photographed
from test_kills import STRATEGIES, moments
from trainings import BUDGETED, Interrupted, read_images, train
strategy, folder = sys.argv[1], Path(sys.argv[2])
for iteration, delay in moments():
    child = os.fork()  # before any kernel has run: threads do not survive it
    if not child:
        kill = threading.Timer(delay, os.kill, (os.getpid(), signal.SIGKILL))
        scene = photographed(folder / "scene")
        objective = Interrupted(read_images(scene.train_views), iteration, kill.start)
        train(scene, replace(STRATEGIES[strategy], checkpoint_seconds=0.0), 0, folder / "run", objective)
        kill.join()
        os._exit(0)
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
"""


def moments():
    """Iterations in ascending order, and seconds after each: anywhere in a step, or while a checkpoint is written."""
    draw = random.Random(SEED)
    return [(iteration, draw.uniform(0, 0.01)) for iteration in sorted(draw.sample(range(150), 3))]


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_three_kills_leave_no_trace(tmp_path, strategy):
    here, tests = Path(__file__).parent, Path(__file__).parents[2]
    places = here, tests / "helpers" / "scenes", tests / "helpers" / "trainings", tests.parent
    command = [sys.executable, "-c", KILLED, strategy, str(tmp_path), *map(str, places)]
    environment = {**os.environ, "NUMBA_NUM_THREADS": "1"}
    process = subprocess.run(command, env=environment, capture_output=True, text=True)
    killed = [str(int(-signal.SIGKILL))] * 3
    assert process.stdout.split() == killed, f"moments {moments()}, seed {SEED}: {process.stderr[-2000:]}"
    scene = photographed(tmp_path / "scene")
    resumed = train(scene, replace(STRATEGIES[strategy], checkpoint_seconds=0.0), 0, tmp_path / "run")
    undisturbed = train(scene, STRATEGIES[strategy], 0, tmp_path / "undisturbed")
    try:
        assert_identical(undisturbed, resumed)
    except AssertionError as difference:
        raise AssertionError(f"killed at {moments()} (iteration, seconds after it), seed {SEED}") from difference
