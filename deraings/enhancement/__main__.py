"""python -m deraings.enhancement train | export | validate | enhance | describe."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

import torch
import tyro
from tqdm import tqdm

from baselines.network_training import network_fingerprint, rounded, take_up
from deraings.enhancement.config import TrainingConfig, Upkeep
from deraings.enhancement.enhance import enhance
from deraings.enhancement.network import CONFIGS, EnhancementNetwork
from deraings.enhancement.pair_folders import PairFolder
from deraings.enhancement.pairs import VEILED, Pairs
from deraings.enhancement.size import describe
from deraings.enhancement.training import Training, train
from deraings.enhancement.validation import as_columns, as_json, scores, table, validation_set
from deraings.enhancement.weights import find_weights, load_enhancer, save_network
from hydroviews.commands import run_command
from hydroviews.errors import InputError
from hydroviews.files import sha256, write_json
from hydroviews.images import list_images, read_image, write_png
from hydroviews.pairs.drawing import LENSES, bake_pool
from hydroviews.pairs.drawn import DrawnRain
from hydroviews.pairs.photographs import LONG_SIDES, frames, read_photographs, split_photographs

WATCHED = 4  # held-out photographs that are looked at while training; all of them at the end
VALIDATION_SEED = 1000  # of the validation rain, whatever the training's seed


@dataclass(frozen=True)
class Data:
    """What to learn from."""

    photographs: Path  # folder of clean photographs; every tenth by name is held out
    pairs: tuple[Path, ...] = ()  # folders of published pairs, each as often as the photographs
    start: str = ""  # weights to begin with, shipped ones or a file; none: begin with chance
    sides: tuple[int, ...] = LONG_SIDES  # pixels; photographs are brought to any of these long sides
    lenses: int = LENSES  # wet lenses baked for landscape and for portrait of every long side
    cache: Path = Path("results/enhancement/rain")  # keeps what Blender bakes

    def __post_init__(self) -> None:
        if not self.sides or self.lenses < 1:
            found = f"--sides {self.sides}, --lenses {self.lenses}"
            raise InputError(f"{found}: nothing to learn from", expected="at least one of each")


@dataclass(frozen=True)
class Request:
    """A training."""

    data: tyro.conf.OmitArgPrefixes[Data]
    training: tyro.conf.OmitArgPrefixes[TrainingConfig] = field(default_factory=TrainingConfig)
    upkeep: tyro.conf.OmitArgPrefixes[Upkeep] = field(default_factory=Upkeep)
    out: Path = Path("results/enhancement/small")  # gets checkpoint, curve, weights and data card
    threads: int = 0  # 0: as many as there are cores
    validated: int = 0  # held-out photographs that the weights are validated on in the end, 0 for all


def train_command(request: tyro.conf.OmitArgPrefixes[Request]) -> None:
    """Train a network, write its weights and data card; the same command goes on where an earlier one stopped."""
    if request.threads:
        torch.set_num_threads(request.threads)
    data, config, split = request.data, request.training, split_photographs(request.data.photographs)
    check_parts(data.sides, config.patch)
    start, words = started_from(data.start, config) if data.start else None, described(data)
    pool = bake_pool(data.cache, config.seed, data.lenses, data.sides)
    published = [PairFolder(folder, config.patch) for folder in data.pairs]
    drawn = DrawnRain(read_photographs(split.training, data.sides), pool)
    veiled = VEILED if config.network.veil else 0
    pairs = Pairs(drawn, published, config.patch, config.seed, veiled)
    watched = validation_set(split.held_out[:WATCHED], VALIDATION_SEED, data.cache / "validation")

    def validate(network: EnhancementNetwork) -> dict[str, float]:
        return as_columns(scores(network, watched))

    training = train(request.out, config, pairs, words, validate, request.upkeep, start)
    write_weights(request, training, words)


def export_command(request: tyro.conf.OmitArgPrefixes[Request]) -> None:
    """Write weights and data card of a training as far as it is; settings as for `train`."""
    if request.threads:
        torch.set_num_threads(request.threads)
    training, words = Training(request.training), described(request.data)
    take_up(training, request.out, network_fingerprint(request.training, words))
    if training.step == 0:
        raise InputError(f"{request.out}: nothing has been trained there", fix="give the folder of a training")
    write_weights(request, training, words)


def started_from(weights: str, config: TrainingConfig) -> EnhancementNetwork:
    """The network of trained weights, for a training to begin with.

    Raises:
        InputError: no such weights, or they are of a network of another width or depth.
    """
    network = load_enhancer(weights).network
    if network.config != config.network:
        raise InputError(
            f"{find_weights(weights)}: cannot begin a training of another network",
            found=f"a network of {network.config}",
            expected=f"one of {config.network}",
        )
    return network


def check_parts(sides: Sequence[int], patch: int) -> None:
    """Are there parts of the wanted size in the smallest frame?

    Raises:
        InputError: there are not.
    """
    width, height = min(frames(sides))
    if min(width, height) < patch:
        raise InputError(
            f"cannot cut parts of {patch}x{patch} pixels",
            found=f"photographs brought to {width}x{height}",
            expected="long sides of at least one and a half times the parts",
            fix="leave the smallest of --sides out, or make --patch smaller",
        )


def described(data: Data) -> str:
    """The data in words, for checkpoint and card."""
    count = len(split_photographs(data.photographs).training)
    folders = [f"{count} photographs ({data.photographs.parent.name}/{data.photographs.name})"]
    folders += [f"pairs of {folder.parent.name}/{folder.name}" for folder in data.pairs]
    sizes = " or ".join(str(side) for side in data.sides)
    words = f"{', '.join(folders)}, {sizes} pixels wide or high; {data.lenses} wet lenses a frame"
    if data.start:
        path = find_weights(data.start)
        words += f"; begun with {path.name} ({load_enhancer(data.start).card['steps']} steps, {sha256(path)[:12]})"
    return words


def write_weights(request: Request, training: Training, data: str) -> None:
    """Validate on held-out photographs, and write weights and data card, which says in words what was learned from."""
    held_out = split_photographs(request.data.photographs).held_out[: request.validated or None]
    training.averaged.load_state_dict(rounded(training.averaged.state_dict()))
    rows = scores(training.averaged, validation_set(held_out, VALIDATION_SEED, request.data.cache / "validation"))
    settings = asdict(request.training)
    card: dict[str, Any] = {
        "data": data,
        "seed": request.training.seed,
        "steps": training.step,
        "of": request.training.steps,
        "seconds": round(training.seconds),
        "training": {name: value for name, value in settings.items() if name not in ("network", "seed", "steps")},
        "held out": [file.name for file in held_out],
        "validation": as_json(rows),
    }
    path = request.out / "weights.safetensors"
    save_network(path, request.training.network, training.averaged.state_dict(), card)
    write_json(path.with_suffix(".json"), {"network": settings["network"], **card})
    print(f"\n{table(rows)}\n\n{path}: {path.stat().st_size / 1e6:.1f} MB")


def validate_command(
    photographs: Path, weights: str = "small", cache: Path = Path("results/enhancement/rain"), pictures: int = 0
) -> None:
    """Print what weights gain on held-out photographs.

    Args:
        photographs: the folder that was trained on; what it holds out is looked at.
        weights: shipped ones, or a file.
        cache: keeps what Blender bakes.
        pictures: how many photographs, 0 for all.
    """
    enhancer = load_enhancer(weights)
    print(enhancer.reason)
    files = split_photographs(photographs).held_out[: pictures or None]
    print(table(scores(enhancer.network, validation_set(files, VALIDATION_SEED, cache / "validation"))))


def enhance_command(pictures: tyro.conf.Positional[Path], out: Path, weights: str = "small") -> None:
    """Enhance a picture, or all of a folder, and write PNG.

    Args:
        pictures: file or folder.
        out: folder.
        weights: shipped ones, or a file.
    """
    enhancer = load_enhancer(weights)
    print(enhancer.reason)
    files = list_images(pictures) if pictures.is_dir() else [pictures]
    for file in tqdm(files, desc="enhancing", unit="picture"):
        write_png(out / f"{file.stem}.png", enhance(read_image(file), enhancer))


def describe_command(network: Literal["paper", "small"] = "small", width: int = 400, height: int = 300) -> None:
    """Print parameters and multiply-adds of a network for pictures of a size.

    Args:
        network: which.
        width: of a picture in pixels.
        height: of a picture in pixels.
    """
    print(describe(CONFIGS[network], width, height))


def main() -> None:
    """Entry point."""
    run_command(
        {
            "train": train_command,
            "export": export_command,
            "validate": validate_command,
            "enhance": enhance_command,
            "describe": describe_command,
        },
        prog="deraings.enhancement",
    )


if __name__ == "__main__":
    main()
