"""What the enhancement network learns from: photographs, the rain drawn on them, published pairs, first weights."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest
from pathlib import Path

from baselines.supervised.commands import in_words
from deraings.enhancement.training.config import TrainingConfig
from deraings.enhancement.training.pair_folders import PairFolder, find_pairs
from deraings.enhancement.training.pairs import MISTED, Pairs
from deraings.enhancement.weights import Enhancer, find_weights, load_enhancer
from hydroviews.errors import InputError
from hydroviews.files.atomic import listing, sha256
from hydroviews.pairs.captures import COMPANIONS
from hydroviews.pairs.drawing import shares_without
from hydroviews.pairs.lens_pool import LENSES, WINDOWS, bake_pool
from hydroviews.pairs.photographs import LONG_SIDES, frames, read_photographs, split_photographs
from hydroviews.pairs.rainy_pairs import DrawnRain

ADDABLE = ("cover", "error", "lens_fine", "lens_mist")  # parts that weights to begin with need not have


@dataclass(frozen=True)
class Data:
    """Training data."""

    photographs: tuple[Path, ...]  # folders of clean photographs; every tenth by name is held out
    pairs: tuple[Path, ...] = ()  # folders of published pairs; each is drawn as often as the photographs
    start: str = ""  # weights to start from: a shipped name or a file. Default: random weights
    sides: tuple[int, ...] = LONG_SIDES  # longer sides in pixels; each photograph is resized to one of them
    lenses: int = LENSES  # wet lenses baked per long side, for landscape and for portrait
    windows: int = WINDOWS  # window panes baked per long side, for landscape and for portrait
    without: tuple[str, ...] = ()  # families of rain to leave out, such as pane or lines
    cache: Path = Path("results/enhancement/rain")  # folder for baked lenses

    def __post_init__(self) -> None:
        if not self.sides or min(self.lenses, self.windows) < 1:
            found = f"--sides {self.sides}, --lenses {self.lenses}, --windows {self.windows}"
            raise InputError(f"{found}: nothing to learn from", expected="at least one of each")
        shares_without(*self.without)

    def held_out(self) -> list[Path]:
        """The photographs that are not learned from, the folders' by turns.

        Raises:
            InputError: a folder without photographs.
        """
        splits = [split_photographs(folder).held_out for folder in self.photographs]
        return [file for files in zip_longest(*splits) for file in files if file is not None]


def training_pairs(data: Data, config: TrainingConfig) -> Pairs:
    """Pairs of a training: the photographs that are not held out in drawn rain, and the published ones.

    Raises:
        InputError: a folder cannot be read, or the smallest photographs are smaller than the parts.
    """
    check_parts(data.sides, config.patch)
    photographs = [file for folder in data.photographs for file in split_photographs(folder).training]
    kinds = shares_without(*data.without)
    windows = data.windows if "window" in kinds else 0
    pool = bake_pool(data.cache, config.seed, data.lenses, data.sides, windows)
    published = [PairFolder(folder, config.patch) for folder in data.pairs]
    companions = COMPANIONS if config.network.lens else (0,)
    drawn = DrawnRain(read_photographs(photographs, data.sides), pool, kinds, companions)
    return Pairs(drawn, published, config.patch, config.seed, MISTED if config.network.mist else 0)


def started_from(data: Data, config: TrainingConfig) -> Enhancer | None:
    """The trained weights that a training begins with; None where it begins with chance.

    Raises:
        InputError: no such weights, or they are of a network of another width or depth.
    """
    if not data.start:
        return None
    enhancer = load_enhancer(data.start, "cpu")
    begun, wanted = enhancer.network.config, config.network
    lacking = {part: getattr(begun, part) for part in ADDABLE if not getattr(begun, part)}
    if begun != replace(wanted, **lacking):
        raise InputError(
            f"{find_weights(data.start)}: cannot begin a training of another network",
            found=f"a network of {enhancer.network.config}",
            expected=f"one of {config.network}",
        )
    return enhancer


def check_parts(sides: Sequence[int], patch: int) -> None:
    """Refuse parts that are larger than the smallest frame.

    Args:
        sides: long sides that photographs are brought to, in pixels.
        patch: side of a part, in pixels.

    Raises:
        InputError: they are.
    """
    width, height = min(frames(sides))
    if min(width, height) < patch:
        raise InputError(
            f"cannot cut parts of {patch}x{patch} pixels",
            found=f"photographs brought to {width}x{height}",
            expected="long sides of at least one and a half times the parts",
            fix="leave the smallest of --sides out, or make --patch smaller",
        )


def described(data: Data, start: Enhancer | None) -> str:
    """The data and the weights to begin with in words, for checkpoint and card."""
    folders = [in_words(split_photographs(folder).training, folder) for folder in data.photographs]
    for folder in data.pairs:
        pairs = find_pairs(folder)
        named = listing(file for pair in pairs for file in pair)
        folders.append(f"{len(pairs)} pairs ({folder.parent.name}/{folder.name}, {named})")
    sizes = " or ".join(str(side) for side in data.sides)
    words = f"{', '.join(folders)}, {sizes} pixels wide or high; "
    words += f"{data.lenses} wet lenses and {data.windows} windows a frame"
    words += f"; no {' and no '.join(data.without)}" if data.without else ""
    if start:
        path = find_weights(data.start)
        words += f"; begun with {path.name} ({start.card['steps']} steps, {sha256(path)[:12]})"
    return words
