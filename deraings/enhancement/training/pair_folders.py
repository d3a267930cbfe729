"""Published rainy and clean pairs: two folders side by side, or one with both.

4K-Rain13k (Chen et al. 2024), UAV-Rain1k (Chang et al. 2024), Rain13k and Rain100 as most restoration code keeps them
have `input` beside `target`; the first release of Rain100 has `rain-001.png` beside `norain-001.png`, and other
copies `rain` or `rainy` beside `norain`, `gt` or `clean`. Names agree but for such words; several rainy pictures may
share a clean one, which is then named like the beginning of theirs.
"""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from hydroviews.errors import InputError
from hydroviews.pairs.drawing import Pair
from hydroviews.scene.images import list_images, read_image

RAINY = ("input", "rain", "rainy", "lq", "data")
CLEAN = ("target", "norain", "gt", "clean", "groundtruth")
WORDS = re.compile(r"(?i)(no)?rain(y)?|input|target|clean|gt")
NAMED_RAINY, NAMED_CLEAN = re.compile(r"(?i)^rain"), re.compile(r"(?i)^norain")

Files = tuple[Path, Path]  # of a rainy and a clean picture


class PairFolder:
    """Pairs of a published data set."""

    def __init__(self, folder: Path, smallest: int) -> None:
        """Of pictures with at least so many pixels along a side."""
        self._files, self._smallest = find_pairs(folder), smallest

    def pair(self, rng: np.random.Generator) -> Pair:
        """See pairs.Source.

        Raises:
            InputError: a picture is unreadable or too small, or a pair's pictures differ in size.
        """
        files = self._files[rng.integers(len(self._files))]
        rainy, clean = (read_image(file) for file in files)
        if rainy.shape != clean.shape:
            raise InputError(f"{files[0]}: not of its clean picture's size", found=rainy.shape, expected=clean.shape)
        if min(rainy.shape[:2]) < self._smallest:
            expected = f"at least {self._smallest} pixels along every side"
            raise InputError(f"{files[0]}: too small", found=rainy.shape, expected=expected)
        height, width = clean.shape[:2]
        unknown = np.full((height, width, 7), np.nan, np.float32)
        alone = np.zeros((0, -(-height // 2), -(-width // 2), 3), np.float32)
        return Pair(rainy, clean, unknown[..., :3], unknown[..., 3:], alone)


def find_pairs(folder: Path) -> list[Files]:
    """Rainy and clean files of a folder, by name of the rainy one.

    Raises:
        InputError: no pairs, or a rainy picture without a clean one.
    """
    rainy, clean = _rainy_and_clean(folder)
    by_key = {_key(file): file for file in clean}
    pairs = []
    for file in rainy:
        match = by_key.get(_key(file)) or _beginning(_key(file), by_key)
        if match is None:
            raise InputError(f"{file}: no clean picture of that name", expected=f"one of {len(clean)} beside it")
        pairs.append((file, match))
    return pairs


def _rainy_and_clean(folder: Path) -> tuple[Sequence[Path], Sequence[Path]]:
    inside = {path.name.lower(): path for path in folder.iterdir() if path.is_dir()} if folder.is_dir() else {}
    rainy = next((inside[name] for name in RAINY if name in inside), None)
    clean = next((inside[name] for name in CLEAN if name in inside), None)
    if rainy and clean:
        return list_images(rainy), list_images(clean)
    files = list_images(folder) if folder.is_dir() else []
    named_rainy, named_clean = ([f for f in files if p.match(f.stem)] for p in (NAMED_RAINY, NAMED_CLEAN))
    if not (named_rainy and named_clean):
        raise InputError(
            f"{folder}: no rainy and clean pictures",
            found=f"folders {', '.join(sorted(inside)) or 'none'}; {len(files)} pictures",
            expected=f"a folder {' or '.join(RAINY)} beside {' or '.join(CLEAN)}, or rain-*.png beside norain-*.png",
            fix="name the folder of the training pairs, such as 4K-Rain13k/train",
        )
    return named_rainy, named_clean


def _key(file: Path) -> str:
    """What names of a pair have in common."""
    return WORDS.sub("", file.stem).strip("-_ ")


def _beginning(key: str, by_key: dict[str, Path]) -> Path | None:
    """The clean picture whose name the rainy one's continues: `0001_2` for `0001`, `1x2` for `1`."""
    heads = [head for head in by_key if key.startswith(head) and not key[len(head) :][:1].isalnum()]
    heads += [head for head in by_key if re.fullmatch(re.escape(head) + r"x\d+", key)]
    return by_key[max(heads, key=len)] if heads else None
