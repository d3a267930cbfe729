"""Patches to learn from: drops drawn on photographs, with the map of where they are.

The map M is the drops' own cover, which the generator of the rain knows, not what has changed by more than a threshold
between rainy and clean as in Qian et al. 2018. Mist changes whole pictures and hides nothing for long, and would be in
the map; a drop before something of its own colour hides it all the same, and would not.
"""

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from hydroviews.pairs.drawing import Pair, draw_rain
from hydroviews.pairs.lens_pool import Pool, WetLens, bake_lens, bake_pool
from hydroviews.pairs.photographs import Bytes, Frame, frames
from hydroviews.pairs.rainy_pairs import DrawnRain
from hydroviews.rain.lens.optics.path_matte import dry
from hydroviews.scene.images import Image
from hydroviews.scene.seeds import generator

KINDS = {"raindrop": 0.95, "clean": 0.05}  # shares of the pairs
DROPS = 1  # the channel of a pair's cover that is theirs
GRADES = ("light", "medium", "heavy")  # of a lens, by index


class Batch(NamedTuple):
    """Patches, several of a picture."""

    rainy: Tensor  # [N, 3, P, P]
    clean: Tensor  # [N, 3, P, P]
    cover: Tensor  # [N, 1, P, P], by drops, [0, 1]


class ValidationPicture(NamedTuple):
    """A held-out photograph in known rain."""

    kind: str  # such as drops-medium; mist, without any drops; or clean
    rainy: Image
    clean: Image
    cover: NDArray[np.float32]  # [H, W], by drops


def lenses(folder: Path, seed: int) -> Pool:
    """Wet lenses of every frame as `bake_pool` keeps them in `folder`, and one with mist alone.

    Raises:
        InputError: see `bake_pool`.
    """
    return {frame: (*wet, without_drops(wet[-1])) for frame, wet in bake_pool(folder, seed).items()}


def without_drops(lens: WetLens) -> WetLens:
    """The same lens with mist alone."""
    return replace(lens, matte=dry(*lens.matte.mask.shape))


class Patches:
    """Batch i, whoever asks for it and whenever."""

    def __init__(self, drawn: DrawnRain, patch: int, crops: int, batch: int, seed: int) -> None:
        """Of drawn rain; `patch` is no larger than any picture."""
        self._drawn, self._patch, self._crops, self._batch, self._seed = drawn, patch, crops, batch, seed

    def __getitem__(self, step: int) -> Batch:
        cut = []
        for index in range(step * self._batch, (step + 1) * self._batch):
            rng = generator(self._seed, "patches", index)
            pair = self._drawn.pair(rng)
            cut += [self._cut(pair, rng) for _ in range(self._crops)]
        return Batch(*(torch.stack(planes) for planes in zip(*cut, strict=True)))

    def _cut(self, pair: Pair, rng: np.random.Generator) -> tuple[Tensor, Tensor, Tensor]:
        """A part of it anywhere, mirrored or not."""
        top, left = (int(rng.integers(size - self._patch + 1)) for size in pair.rainy.shape[:2])
        rows, columns = slice(top, top + self._patch), slice(left, left + self._patch)
        step = -1 if rng.uniform() < 0.5 else 1
        planes = (pair.rainy, pair.clean, pair.cover[..., DROPS : DROPS + 1])
        rainy, clean, cover = (as_tensor(plane[rows, columns][:, ::step]) for plane in planes)
        return rainy, clean, cover


def as_tensor(plane: NDArray) -> Tensor:
    """[H, W, C] as [C, H, W]."""
    return torch.from_numpy(np.ascontiguousarray(plane.transpose(2, 0, 1), np.float32))


def validation_set(photographs: list[dict[int, Bytes]], folder: Path, seed: int) -> list[ValidationPicture]:
    """Every photograph at its smaller size with drops of every grade, with mist alone, and clean.

    Args:
        photographs: held out.
        folder: keeps what Blender bakes.
        seed: of lenses and rain.

    Raises:
        InputError: Blender failed.
    """
    sizes = [frame for frame in frames() if max(frame) == min(photographs[0])]
    pool = {frame: [bake_lens(folder, seed, frame, grade) for grade in range(len(GRADES))] for frame in sizes}
    pictures = []
    for number, sides in enumerate(photographs):
        photograph = sides[min(sides)]
        frame: Frame = (photograph.shape[1], photograph.shape[0])
        wet = {f"drops-{name}": lens for name, lens in zip(GRADES, pool[frame], strict=True)}
        for kind, lens in {**wet, "mist": without_drops(pool[frame][-1]), "clean": pool[frame][0]}.items():
            drawn_as = "clean" if kind == "clean" else "raindrop"
            rainy, clean, cover, *_ = draw_rain(photograph, drawn_as, [lens], generator(seed, "watched", number, kind))
            pictures.append(ValidationPicture(kind, rainy, clean, cover[..., DROPS]))
    return pictures
