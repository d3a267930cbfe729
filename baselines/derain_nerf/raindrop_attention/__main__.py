"""python -m baselines.derain_nerf.raindrop_attention train | export | validate | detect."""

from hydroviews.cli.starting import begin

if __name__ == "__main__":
    begin()

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
import tyro
from torch import nn
from tqdm import tqdm

from baselines.derain_nerf.raindrop_attention.config import CONFIGS, TrainingConfig
from baselines.derain_nerf.raindrop_attention.detection import detect
from baselines.derain_nerf.raindrop_attention.network import DerainGenerator
from baselines.derain_nerf.raindrop_attention.pairs import KINDS, Patches, ValidationPicture, lenses, validation_set
from baselines.derain_nerf.raindrop_attention.training import AttentionTraining
from baselines.derain_nerf.raindrop_attention.validation import as_columns, scores, table
from baselines.derain_nerf.raindrop_attention.weights import FILES, load_detector
from baselines.supervised import commands as supervised
from baselines.supervised.training import Validate
from baselines.supervised.validation import as_json
from baselines.supervised.weights import NetworkFiles
from hydroviews.cli.commands import run_command
from hydroviews.files.ownership import require_ours
from hydroviews.formats.photographs import one_by_one
from hydroviews.pairs.lens_pool import LENSES
from hydroviews.pairs.photographs import read_photographs, split_photographs
from hydroviews.pairs.rainy_pairs import DrawnRain
from hydroviews.scene.images import read_image, write_png

CACHE = Path("results/raindrop-attention/rain")
VALIDATION_SEED = 1000  # of lenses and rain of the validation, whatever the training's seed


@dataclass(frozen=True)
class TrainingRequest(supervised.TrainingRequest):
    """A training of the network that finds and removes raindrops."""

    photographs: Path  # folder of clean photographs; every tenth by name is held out
    network: Literal["small", "paper"] = "small"
    seed: int = 0
    steps: int = 0  # 0: the configuration's number
    cache: Path = CACHE  # folder for baked lenses
    # Folder of checkpoint, curve, weights and data card.
    out: Path = field(default=Path("results/raindrop-attention/small"), kw_only=True)
    watched: int = 4  # held-out photographs of the validations while training

    files: ClassVar[NetworkFiles] = FILES

    def training(self) -> TrainingConfig:
        """The configuration of the network, with the request's seed and steps."""
        config = CONFIGS[self.network]
        return replace(config, seed=self.seed, steps=self.steps or config.steps)

    def begin(self) -> AttentionTraining:
        """See supervised.TrainingRequest."""
        return AttentionTraining(self.training())

    def described(self) -> str:
        """See supervised.TrainingRequest."""
        photographs = supervised.in_words(split_photographs(self.photographs).training, self.photographs)
        return f"{photographs}; {LENSES} wet lenses a frame, and mist alone"

    def batches(self) -> Patches:
        """See supervised.TrainingRequest."""
        config, files = self.training(), split_photographs(self.photographs).training
        drawn = DrawnRain(read_photographs(files), lenses(self.cache, config.seed), KINDS)
        return Patches(drawn, config.patch, config.crops, config.batch, config.seed)

    def validation(self) -> Validate:
        """See supervised.TrainingRequest."""
        pictures = _held_out(self.photographs, self.cache, self.watched)
        return lambda generator: as_columns(scores(generator, pictures))

    def judged(self, network: nn.Module) -> tuple[dict[str, Any], str]:
        """See supervised.TrainingRequest."""
        assert isinstance(network, DerainGenerator)
        rows = scores(network, _held_out(self.photographs, self.cache, self.validated))
        names = [file.name for file in split_photographs(self.photographs).held_out]
        return {"held out": names, "validation": as_json(rows, decimals=4)}, table(rows)


def train_command(request: tyro.conf.OmitArgPrefixes[TrainingRequest]) -> None:
    """Train a network, write its weights and data card; an interrupted command resumes when repeated."""
    supervised.train_network(request)


def export_command(request: tyro.conf.OmitArgPrefixes[TrainingRequest]) -> None:
    """Write weights and data card of an unfinished training; settings as for `train`."""
    supervised.export_network(request)


def validate_command(photographs: Path, weights: str = "small", cache: Path = CACHE) -> None:
    """Print how well weights detect and remove drops on held-out photographs.

    Args:
        photographs: the folder of the training; its held-out photographs are used.
        weights: name of shipped weights, or a file.
        cache: folder for baked lenses.
    """
    print(table(scores(load_detector(weights), _held_out(photographs, cache))))


def detect_command(pictures: tyro.conf.Positional[Path], out: Path, weights: str = "small") -> None:
    """Detect drops in a picture or a folder; write picture, attention map and derained picture side by side.

    Args:
        pictures: a file or a folder.
        out: another folder.
        weights: name of shipped weights, or a file.

    Raises:
        InputError: a picture that cannot be read, or a file of another origin that would be written over.
    """
    generator, targets = load_detector(weights), one_by_one(pictures, out)
    require_ours(targets.values())
    for file, target in tqdm(targets.items(), desc="detecting", unit="picture"):
        image = read_image(file)
        attention, derained = detect(image, generator)
        write_png(target, np.hstack([image, attention[..., None].repeat(3, axis=2), derained]))


def _held_out(photographs: Path, cache: Path, count: int = 0) -> list[ValidationPicture]:
    files = split_photographs(photographs).held_out[: count or None]
    return validation_set(read_photographs(files), cache / "attention", VALIDATION_SEED)


def main() -> None:
    """Entry point."""
    run_command(
        {
            "train": train_command,
            "export": export_command,
            "validate": validate_command,
            "detect": detect_command,
        },
        prog="baselines.derain_nerf.raindrop_attention",
    )


if __name__ == "__main__":
    main()
