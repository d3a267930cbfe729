"""Pairs to learn from: rain drawn on photographs, or folders of pairs that others have published."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np
import torch
from torch import Tensor
from torch.utils.data import DataLoader, Dataset

from deraings.enhancement.photographs import Bytes, Frame
from deraings.enhancement.rain import KINDS, LINEAR, Pair, Pool, Window, draw_rain
from hydroviews.images import to_srgb
from hydroviews.rain.seeds import generator

DIMMEST = 0.35  # the darkest exposure that photographs are given, in linear light
CAST = 0.1  # by how much the channels' exposures differ, at most


class Source(Protocol):
    """Where pairs come from."""

    def pair(self, patch: int, rng: np.random.Generator) -> Pair:
        """A pair of [patch, patch] pixels; all chance comes from the generator."""
        ...


class DrawnRain:
    """Photographs with rain drawn when it is asked for."""

    def __init__(self, photographs: Sequence[dict[int, Bytes]], pool: Pool) -> None:
        self._photographs, self._pool = photographs, pool

    def pair(self, patch: int, rng: np.random.Generator) -> Pair:
        """See Source."""
        sides = self._photographs[rng.integers(len(self._photographs))]
        photograph = sides[int(rng.choice(list(sides)))]
        if rng.uniform() < 0.5:
            photograph = photograph[:, ::-1]
        photograph = exposed(photograph, rng)
        height, width = photograph.shape[:2]
        kind = str(rng.choice(list(KINDS), p=list(KINDS.values())))
        frame: Frame = (width, height)
        return flipped(draw_rain(photograph, kind, self._pool[frame], window(height, width, patch, rng), rng), rng)


def exposed(photograph: Bytes, rng: np.random.Generator) -> Bytes:
    """The photograph [H, W, 3] as a shorter exposure in other light, so that dark scenes are learned too."""
    gains = rng.uniform(DIMMEST, 1) * rng.uniform(1 - CAST, 1, 3)
    table = np.stack([np.rint(255 * to_srgb(LINEAR * gain)) for gain in gains], axis=1).astype(np.uint8)
    return np.stack([table[photograph[..., channel], channel] for channel in range(3)], axis=-1)


def window(height: int, width: int, patch: int, rng: np.random.Generator) -> Window:
    """A square part of a picture, anywhere in it."""
    top, left = int(rng.integers(height - patch + 1)), int(rng.integers(width - patch + 1))
    return slice(top, top + patch), slice(left, left + patch)


def flipped(pair: Pair, rng: np.random.Generator) -> Pair:
    """All of it mirrored left to right, or not: rain leans both ways, but does not fall up."""
    return Pair(*(plane[:, ::-1] for plane in pair)) if rng.uniform() < 0.5 else pair


class Pairs(Dataset):
    """Pair i, whoever asks for it and whenever: of one of the sources, all equally often."""

    def __init__(self, sources: Sequence[Source], patch: int, seed: int) -> None:
        self._sources, self._patch, self._seed = sources, patch, seed

    def __getitem__(self, index: int) -> tuple[Tensor, ...]:
        """Rainy, clean and cover, [3, patch, patch]."""
        rng = generator(self._seed, "pair", index)
        source = self._sources[rng.integers(len(self._sources))]
        planes = (plane.transpose(2, 0, 1) for plane in source.pair(self._patch, rng))
        return tuple(torch.from_numpy(np.ascontiguousarray(plane)) for plane in planes)


def batches(pairs: Pairs, batch: int, first: int, last: int, workers: int) -> DataLoader:
    """The batches of steps `first` to `last` - 1, drawn ahead by so many processes; by this one if there are none."""
    indices = [list(range(step * batch, (step + 1) * batch)) for step in range(first, last)]
    return DataLoader(pairs, batch_sampler=indices, num_workers=workers)
