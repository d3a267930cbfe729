"""python -m baselines.derain_nerf.raindrop_attention train | export | validate | detect."""

from hydroviews.cli.starting import begin

if __name__ == "__main__":
    begin()

from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tyro
from tqdm import tqdm

from baselines.derain_nerf.raindrop_attention.config import CONFIGS, TrainingConfig
from baselines.derain_nerf.raindrop_attention.detection import detect
from baselines.derain_nerf.raindrop_attention.network import DerainGenerator
from baselines.derain_nerf.raindrop_attention.pairs import KINDS, Patches, ValidationPicture, lenses, validation_set
from baselines.derain_nerf.raindrop_attention.training import AttentionTraining, train
from baselines.derain_nerf.raindrop_attention.validation import as_columns, scores, table
from baselines.derain_nerf.raindrop_attention.weights import load_detector, save_generator
from baselines.training.network_commands import WEIGHTS, in_words, load_trained, require_own_files, rounded, use_threads
from baselines.training.supervised_training import Intervals, network_fingerprint
from baselines.training.validation import as_json
from hydroviews.cli.commands import run_command
from hydroviews.files.atomic import write_json
from hydroviews.files.ownership import require_ours
from hydroviews.formats.photographs import one_by_one
from hydroviews.pairs.lens_pool import LENSES
from hydroviews.pairs.photographs import read_photographs, split_photographs
from hydroviews.pairs.rainy_pairs import DrawnRain
from hydroviews.scene.images import read_image, write_png

CACHE = Path("results/raindrop-attention/rain")
VALIDATION_SEED = 1000  # of lenses and rain of the validation, whatever the training's seed


@dataclass(frozen=True)
class TrainingRequest:
    """A training."""

    photographs: Path  # folder of clean photographs; every tenth by name is held out
    network: Literal["small", "paper"] = "small"
    seed: int = 0
    steps: int = 0  # 0: the configuration's number
    cache: Path = CACHE  # folder for baked lenses
    out: Path = Path("results/raindrop-attention/small")  # folder of checkpoint, curve, weights and data card
    intervals: tyro.conf.OmitArgPrefixes[Intervals] = field(default_factory=Intervals)
    threads: int = 0  # 0: one per core
    workers: int = 0  # processes that draw patches ahead
    watched: int = 4  # held-out photographs of the validations while training
    validated: int = 0  # held-out photographs of the last validation, 0 for all

    def training(self) -> TrainingConfig:
        """The configuration of the network, with the request's seed and steps."""
        config = CONFIGS[self.network]
        return replace(config, seed=self.seed, steps=self.steps or config.steps)


def train_command(request: tyro.conf.OmitArgPrefixes[TrainingRequest]) -> None:
    """Train a network, write its weights and data card; an interrupted command resumes when repeated."""
    use_threads(request.threads)
    require_own_files(request.out)
    config, split = request.training(), split_photographs(request.photographs)
    drawn = DrawnRain(read_photographs(split.training), lenses(request.cache, config.seed), KINDS)
    patches = Patches(drawn, config.patch, config.crops, config.batch, config.seed)
    pictures = _held_out(request.photographs, request.cache, request.watched)

    def validate(generator: DerainGenerator) -> dict[str, float]:
        return as_columns(scores(generator, pictures))

    training = train(request.out, config, patches, described(request), validate, request.intervals, request.workers)
    write_weights(request, training)


def export_command(request: tyro.conf.OmitArgPrefixes[TrainingRequest]) -> None:
    """Write weights and data card of an unfinished training; settings as for `train`."""
    use_threads(request.threads)
    training = AttentionTraining(request.training())
    load_trained(training, request.out, network_fingerprint(training.config, described(request)))
    write_weights(request, training)


def write_weights(request: TrainingRequest, training: AttentionTraining) -> None:
    """Validate on held-out photographs, and write weights and data card."""
    training.averaged.load_state_dict(rounded(training.averaged.state_dict()))
    rows = scores(training.averaged, _held_out(request.photographs, request.cache, request.validated))
    settings = asdict(training.config)
    generator = settings.pop("generator")
    card: dict[str, Any] = {
        "data": described(request),
        "steps": training.iteration,
        "seconds": round(training.seconds),
        "training": settings,
        "held out": [file.name for file in split_photographs(request.photographs).held_out],
        "validation": as_json(rows, decimals=4),
    }
    path = request.out / WEIGHTS
    save_generator(path, training.config.generator, training.averaged.state_dict(), card)
    write_json(path.with_suffix(".json"), {"generator": generator, **card})
    print(table(rows), f"\nwritten: {path}")


def validate_command(photographs: Path, weights: str = "small", cache: Path = CACHE) -> None:
    """Print how well weights detect and remove drops on held-out photographs.

    Args:
        photographs: the folder of the training; its held-out photographs are used.
        weights: name of shipped weights, or a file.
        cache: folder for baked lenses.
    """
    print(table(scores(load_detector(weights).generator, _held_out(photographs, cache))))


def detect_command(pictures: tyro.conf.Positional[Path], out: Path, weights: str = "small") -> None:
    """Detect drops in a picture or a folder; write picture, attention map and derained picture side by side.

    Args:
        pictures: a file or a folder.
        out: another folder.
        weights: name of shipped weights, or a file.

    Raises:
        InputError: a picture that cannot be read, or a file of another origin that would be written over.
    """
    generator, targets = load_detector(weights).generator, one_by_one(pictures, out)
    require_ours(targets.values())
    for file, target in tqdm(targets.items(), desc="detecting", unit="picture"):
        image = read_image(file)
        attention, derained = detect(image, generator)
        write_png(target, np.hstack([image, attention[..., None].repeat(3, axis=2), derained]))


def described(request: TrainingRequest) -> str:
    """The data in words, for checkpoint and card."""
    photographs = in_words(split_photographs(request.photographs).training, request.photographs)
    return f"{photographs}; {LENSES} wet lenses a frame, and mist alone"


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
