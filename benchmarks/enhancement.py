"""Speed and error of enhancement: networks of several widths, trained alike.

    python -m benchmarks enhancement --photographs FOLDER --out results/bench/enhancement

Each width is trained for the same number of steps on the same pairs, then validated on held-out photographs; an
interrupted run goes on where it stopped. Prints a table and writes enhancement.csv. Times are processor time of one
thread, the least of several turns; memory is the peak of a process of its own with a picture of 1.1 megapixels, over
that with a small one.
"""

import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch
import tyro

from baselines.supervised.config import Intervals
from baselines.supervised.training import train
from benchmarks.tables import report, rows_of
from benchmarks.timing import least
from deraings.enhancement.__main__ import VALIDATION_SEED, WATCHED
from deraings.enhancement.architecture.network import CONFIGS, EnhancementNetwork, NetworkConfig
from deraings.enhancement.architecture.size import measure
from deraings.enhancement.enhance import enhance
from deraings.enhancement.training.config import TrainingConfig
from deraings.enhancement.training.data import Data, described, training_pairs
from deraings.enhancement.training.pairs import Batches, Pairs
from deraings.enhancement.training.training import EnhancementTraining
from deraings.enhancement.validation.pictures import validation_set
from deraings.enhancement.validation.scores import as_columns, scores
from deraings.enhancement.weights import Enhancer

SIZE = 400, 300
LARGE = 1200, 900
TURNS = 3
MEMORY = """
import sys, torch
from deraings.enhancement.enhance import enhance
from deraings.enhancement.architecture.network import CONFIGS, EnhancementNetwork
from deraings.enhancement.weights import Enhancer
from dataclasses import replace
from leaderboard.runs.train_and_render import peak_memory_mb
torch.set_num_threads(1)
width, columns, rows = (int(word) for word in sys.argv[2:])
network = EnhancementNetwork(replace(CONFIGS[sys.argv[1]], width=width, head_width=width)).eval()
enhance(torch.rand(rows, columns, 3).numpy(), Enhancer(network, {}, "being measured"))
print(peak_memory_mb())
"""


@dataclass(frozen=True)
class Choice:
    """What to compare."""

    photographs: Path  # to train on; every tenth by name is held out
    out: Path = Path("results/bench/enhancement")
    cache: Path = Path("results/enhancement/rain")  # keeps what Blender bakes
    network: str = "small"  # of which the width is changed
    widths: tuple[int, ...] = (12, 24, 36)
    steps: int = 400


def seconds_a_picture(network: EnhancementNetwork) -> float:
    """Processor time of one picture."""
    picture, enhancer = torch.rand(SIZE[1], SIZE[0], 3).numpy(), Enhancer(network, {}, "being measured")
    return least(lambda: enhance(picture, enhancer), TURNS) / 1000


def megabytes(name: str, width: int) -> float:
    """Memory that a large picture needs beyond a small one, in 10^6 bytes."""

    def peak(columns: int, rows: int) -> float:
        command = [sys.executable, "-c", MEMORY, name, *map(str, (width, columns, rows))]
        return float(subprocess.run(command, check=True, capture_output=True, text=True).stdout)

    return peak(*LARGE) - peak(64, 64)


def row(choice: Choice, data: Data, config: NetworkConfig, pairs: Pairs, validate: Callable) -> dict[str, Any]:
    """One width: size, time, memory, and PSNR after training."""
    trained = EnhancementTraining(TrainingConfig(network=config, steps=choice.steps))
    intervals = Intervals(validate_every=choice.steps)
    folder, words = choice.out / f"width-{config.width}", described(data, None)
    train(trained, Batches(pairs, trained.config.batch), folder, words, validate, intervals)
    parts = measure(config, *SIZE).values()
    megapixels = SIZE[0] * SIZE[1] / 1e6
    return {
        "width": config.width,
        "parameters_m": round(sum(part.parameters for part in parts) / 1e6, 2),
        "operations_g": round(sum(part.operations for part in parts) / 1e9, 2),
        "s_per_megapixel": round(seconds_a_picture(trained.averaged) / megapixels, 2),
        "mb_at_1.1_megapixels": round(megabytes(choice.network, config.width)),
        "training_s": round(trained.seconds),
        **{name: round(value, 2) for name, value in trained.curve[-1].items() if name not in ("step", "seconds")},
    }


def main(choice: tyro.conf.OmitArgPrefixes[Choice]) -> None:
    """Train networks of several widths alike and report."""
    torch.set_num_threads(1)
    config, data = CONFIGS[choice.network], Data((choice.photographs,), cache=choice.cache)
    pairs = training_pairs(data, TrainingConfig(network=config))
    watched = validation_set(data.held_out()[:WATCHED], VALIDATION_SEED, choice.cache / "validation")

    def validate(network: EnhancementNetwork) -> dict[str, float]:
        return as_columns(scores(network, watched))

    widths = [replace(config, width=width, head_width=width) for width in choice.widths]
    table = rows_of(lambda width: row(choice, data, width, pairs, validate), [(width,) for width in widths], "widths")
    report(table, choice.out / "enhancement.csv")
