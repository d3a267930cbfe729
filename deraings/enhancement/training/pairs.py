"""Pairs to learn from: rain drawn on photographs, or folders of pairs that others have published."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple, Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from deraings.enhancement.architecture.lens_statistics import coarse_statistics, fine_statistics, halved, over_pictures
from deraings.enhancement.architecture.mist_branch import SIDE, Box, cell_statistics, squeezed
from hydroviews.pairs.camera import compressed, noisy
from hydroviews.pairs.drawing import Pair, each
from hydroviews.pairs.rainy_pairs import DrawnRain
from hydroviews.scene.images import Image
from hydroviews.scene.seeds import generator

COMPRESSED = 0.1  # share of the rainy pairs that are stored as JPEG after the rain
QUALITIES = (70, 96)  # of JPEG
NOISY = 0.2  # share of the rainy pairs that a camera's sensor gives noise
NOISIEST = 0.015  # its standard deviation at most, in encoded values
MISTED = 8  # small whole pictures in mist alone that come with a pair where a network for the mist learns of many


class Source(Protocol):
    """Where pairs come from."""

    def pair(self, rng: np.random.Generator) -> Pair:
        """A whole picture in rain, and clean; all chance comes from the generator."""
        ...


class Sample(NamedTuple):
    """What a network learns from: a part of a pair, and the whole of it in small. A batch has them stacked."""

    rainy: Tensor  # [3, patch, patch]
    clean: Tensor  # [3, patch, patch]
    cover: Tensor  # [3, patch, patch]
    box: Tensor  # [4], which part it is: see mist_branch.Box
    whole_rainy: Tensor  # [1 + misted, 3, 128, 128], the pair's, then others in mist alone
    whole_clean: Tensor  # [1 + misted, 3, 128, 128]
    whole_mist: Tensor  # [1 + misted, 4, 128, 128], as in drawing.Pair
    coarse: Tensor  # [1 + misted, COARSE, 16, 16], statistics of the wholes' captures: see lens_statistics
    fine: Tensor  # [FINE, patch / 2, patch / 2], of the part's


class Pairs:
    """Sample i, whoever asks for it and whenever: of photographs in drawn rain or of a published pair, by turns."""

    def __init__(
        self, drawn: DrawnRain, published: Sequence[Source], patch: int, seed: int, misted: int = MISTED
    ) -> None:
        self._drawn, self._sources, self._patch, self._seed = drawn, [drawn, *published], patch, seed
        self._misted = misted

    def __getitem__(self, index: int) -> Sample:
        """Mirrored left to right or not, since rain leans both ways but does not fall up; any part of it.

        Raises:
            ValueError: the picture is smaller than the part.
        """
        rng = generator(self._seed, "pair", index)
        pair = self._sources[rng.integers(len(self._sources))].pair(rng)
        pair = sensed(pair, rng) if rng.uniform() < NOISY else pair
        pair = stored(pair, rng) if rng.uniform() < COMPRESSED else pair
        if rng.uniform() < 0.5:
            pair = Pair(*(plane[..., ::-1, :] for plane in pair))
        rows, columns, box = part_of(pair.rainy.shape[0], pair.rainy.shape[1], self._patch, rng)
        parts = [_planes(plane[rows, columns]) for plane in (pair.rainy, pair.clean, pair.cover)]
        capture = _capture(halved(_planes(pair.rainy)[None]), pair.companions)
        own = [*(_small(plane) for plane in (pair.rainy, pair.clean, pair.mist)), coarse_statistics(capture)]
        others = misted(self._drawn, rng, self._misted) if self._misted else []
        wholes = [torch.stack(planes) for planes in zip(own, *others, strict=True)]
        fine = fine_statistics(capture[..., _half(rows), _half(columns)])
        return Sample(*parts, torch.tensor(box), *wholes, fine)  # type: ignore[call-arg]


class Batches:
    """Samples stacked, by step: step i learns from pairs i N to i N + N - 1."""

    def __init__(self, pairs: Pairs, size: int) -> None:
        self._pairs, self._size = pairs, size

    def __getitem__(self, step: int) -> Sample:
        samples = [self._pairs[index] for index in range(step * self._size, (step + 1) * self._size)]
        return Sample(*(torch.stack(tensors) for tensors in zip(*samples, strict=True)))


def sensed(pair: Pair, rng: np.random.Generator) -> Pair:
    """The pair with noise of a sensor on its rainy pictures; where there is no rain it stays as it is."""
    return taken(pair, lambda: partial(noisy, sigma=float(rng.uniform(0, NOISIEST)), rng=rng))


def stored(pair: Pair, rng: np.random.Generator) -> Pair:
    """The pair with its rainy pictures stored as JPEG; where there is no rain it stays as it is."""
    return taken(pair, lambda: partial(compressed, quality=int(rng.integers(*QUALITIES))))


def taken(pair: Pair, draw: Callable[[], Callable[[Image], Image]]) -> Pair:
    """The pair with one drawn change to all rainy pictures; nothing is drawn where there is no rain."""
    if np.array_equal(pair.rainy, pair.clean):
        return pair
    change = draw()
    companions = each(change, pair.companions)
    return pair._replace(rainy=change(pair.rainy), companions=companions)


def part_of(height: int, width: int, patch: int, rng: np.random.Generator) -> tuple[slice, slice, Box]:
    """Rows and columns of a square part of a picture, anywhere in it from an even row and column on."""
    top, left = (2 * int(rng.integers((size - patch) // 2 + 1)) for size in (height, width))
    box = top / height, (top + patch) / height, left / width, (left + patch) / width
    return slice(top, top + patch), slice(left, left + patch), box


def _half(span: slice) -> slice:
    return slice(span.start // 2, -(-span.stop // 2))


def _capture(own: Tensor, companions: NDArray[np.float32]) -> Tensor:
    """A picture [1, 3, H, W] and its companions [K, H, W, 3]: [1 + K, 3, H, W]."""
    return torch.cat([own, torch.from_numpy(np.ascontiguousarray(companions.transpose(0, 3, 1, 2)))])


def misted(drawn: DrawnRain, rng: np.random.Generator, count: int) -> list[list[Tensor]]:
    """So many pictures of one capture in mist alone: rainy, clean, mist, coarse statistics.

    Each has companions of its own number: drawing them costs more than summing them up in several ways.
    """
    together = [1 + drawn.companions(rng) for _ in range(count)]
    rainy, clean, mist = drawn.misted(rng, SIDE, max([count, *together]))
    cells = cell_statistics(torch.from_numpy(rainy).permute(0, 3, 1, 2).contiguous())
    return [
        [_planes(rainy[i]), _planes(clean[i]), _planes(mist), over_pictures(cells.roll(-i, 0)[:number])]
        for i, number in enumerate(together)
    ]


def _planes(picture: Image) -> Tensor:
    return torch.from_numpy(np.ascontiguousarray(picture.transpose(2, 0, 1), np.float32))


def _small(picture: Image) -> Tensor:
    return squeezed(_planes(picture)[None])[0]
