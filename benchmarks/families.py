"""What a network gains in rain that it has not learned: one family of the training's rain is left out at a time.

    python -m benchmarks families --photographs FOLDER --start small --out results/bench/families

Every training begins with the same weights and takes the same steps. An interrupted run goes on where it stopped.
Prints gains in dB on held-out photographs, a row a training, and writes families.csv. Look at the column of the family
that a row leaves out: its gain is smaller than in the first row by as much as training on that family brings.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import pandas as pd
import torch
import tyro

from baselines.supervised.config import Intervals
from baselines.supervised.training import Validate, train
from benchmarks.tables import report
from deraings.enhancement.__main__ import VALIDATION_SEED, WATCHED
from deraings.enhancement.architecture.network import EnhancementNetwork
from deraings.enhancement.training.config import TrainingConfig
from deraings.enhancement.training.data import Data, described, started_from, training_pairs
from deraings.enhancement.training.pairs import Batches
from deraings.enhancement.training.training import EnhancementTraining
from deraings.enhancement.validation.pictures import FAMILIES, validation_set
from deraings.enhancement.validation.scores import scores
from hydroviews.pairs.drawing import FALL, LENS
from hydroviews.pairs.photographs import LONG_SIDES
from hydroviews.rain.patterns import Pattern

MEDIUM = tuple(Pattern(effect, 1) for effect in ("window", "raindrop", "streak"))
LEFT_OUT = *LENS, *FALL


@dataclass(frozen=True)
class Choice:
    """What to compare."""

    photographs: tuple[Path, ...]  # to train on; every tenth by name is held out
    start: str = ""  # weights to begin with; none: chance
    sides: tuple[int, ...] = LONG_SIDES  # long sides in pixels that photographs are brought to
    out: Path = Path("results/bench/families")
    cache: Path = Path("results/enhancement/rain")  # keeps what Blender bakes
    steps: int = 400
    pictures: int = WATCHED  # held-out photographs


def main(choice: tyro.conf.OmitArgPrefixes[Choice]) -> None:
    """Train with all families, then without each, and report."""
    torch.set_num_threads(1)
    every = Data(choice.photographs, sides=choice.sides, start=choice.start, cache=choice.cache)
    held_out = every.held_out()[: choice.pictures]
    watched = validation_set(held_out, VALIDATION_SEED, choice.cache / "validation", 0, MEDIUM, FAMILIES)

    def gains(network: EnhancementNetwork) -> dict[str, float]:
        return {row.kind: row.after - row.before for row in scores(network, watched) if row.kind != "clean"}

    rows = {"nothing": trained(choice, every, gains)}
    for family in LEFT_OUT:
        rows[family] = trained(choice, replace(every, without=(family,)), gains)
        table = pd.DataFrame(rows).T.round(2).rename_axis("left out").reset_index()
        report(table, choice.out / "families.csv")


def trained(choice: Choice, data: Data, gains: Validate) -> dict[str, float]:
    """Gains of a training by kind of rain."""
    config = TrainingConfig(steps=choice.steps)
    start = started_from(data, config)
    folder = choice.out / ("without-" + "-".join(data.without) if data.without else "all")
    batches, words = Batches(training_pairs(data, config), config.batch), described(data, start)
    intervals = Intervals(validate_every=choice.steps)
    training = EnhancementTraining(config, start=start.network if start else None)
    train(training, batches, folder, words, gains, intervals)
    return {name: value for name, value in training.curve[-1].items() if name not in ("step", "seconds", "loss")}
