"""A sweep as one array of Slurm: a script, one task a run."""

import math
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path

from hydroviews.files.atomic import write_bytes
from leaderboard.runs.run import Run
from leaderboard.runs.supervision import Limits
from leaderboard.sweep.local import LOGS, MEMORY, run_environment
from leaderboard.sweep.one import options

# A run has to meet its own limits before Slurm does, which kills it without a record. Not in its time limit: programs
# that start, a method that is given time to stop, scores, whose networks are slow on large pictures. Not in its memory
# limit, which is of the method's process: the one that watches it (0.2 GB), and files' pages, which Slurm counts too.
SPARE_MINUTES = 30
SPARE_MEMORY = 1.0  # 10^9 bytes

SCRIPT = """\
#!/bin/bash
#SBATCH --job-name=hydroviews
#SBATCH --array=0-{last}
#SBATCH --cpus-per-task={threads}
#SBATCH --mem={megabytes}M
#SBATCH --time={minutes}
#SBATCH --requeue
#SBATCH --output={output}
# Options of sbatch on its command line go before these: sbatch --gres=gpu:1 --time=120 THIS_FILE
# When all tasks have ended: leaderboard table --results {results}
set -e
cd {here}
export {settings}
runs=(
{runs}
)
eval "exec ${{runs[$SLURM_ARRAY_TASK_ID]}}"
"""


def write_slurm(path: Path, runs: Sequence[Run], limits: Limits, threads: int) -> None:
    """Write the script of a Slurm array that carries out the runs from this folder, on a disk that all nodes share."""
    command = [sys.executable, "-m", "leaderboard.sweep.task"]
    logs = runs[0].results / LOGS
    logs.mkdir(parents=True, exist_ok=True)  # Slurm does not make it
    text = SCRIPT.format(
        last=len(runs) - 1,
        threads=threads,
        megabytes=math.ceil(((limits.memory or MEMORY) + SPARE_MEMORY) * 1000),
        minutes=math.ceil(limits.time * 60) + SPARE_MINUTES,
        output=shlex.quote(f"{logs.absolute()}/".replace("%", "%%") + "slurm-%A-%a.log"),  # sbatch takes quotes off
        results=shlex.quote(str(runs[0].results)),
        here=shlex.quote(str(Path.cwd())),
        settings=" ".join(f"{name}={value}" for name, value in run_environment(threads).items()),
        runs="\n".join("  " + shlex.quote(shlex.join([*command, *options(run, limits)])) for run in runs),
    )
    write_bytes(path, text.encode())
