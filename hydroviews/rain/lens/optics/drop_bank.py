"""Baked drops that can be shown one by one, at other places than those they were baked at.

A lens is baked as for a path matte, and its pixels and light paths are told apart by body of water. A drop that is
moved by some pixels takes its paths along: a thin drop turns light by the same angle wherever it sits. Where they end
is mirrored at the picture's borders only then. `benchmarks.raindrops` has what the move costs in accuracy.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from hydroviews.files.atomic import replacing
from hydroviews.rain.lens.optics.path_matte import UNREADABLE, corners, damaged, load_arrays, mirrored
from hydroviews.scene.images import Image

Plane = NDArray[np.float32]
BEYOND = 6  # pictures to either side of the picture where moved paths may end


@dataclass(frozen=True, eq=False)
class DropBank:
    """The drops of one baked lens. Places are pixels of the picture, from its upper left one; they may lie outside."""

    starts: NDArray[np.int64]  # [S + 1], where the lens pixels of each body begin
    pixels: NDArray[np.signedinteger]  # [P, 2], x and y of lens pixels
    cover: Plane  # [P]
    ambient: Plane  # [P], share of the cover's light that no path accounts for
    path_starts: NDArray[np.int64]  # [P + 1], where the paths of each lens pixel begin
    ends: NDArray[np.signedinteger]  # [N, 2], x and y of where they end
    weights: Plane  # [N], what they bring of the light there
    sky: Plane | None = None  # [P], the part of the light that is bright of its own; windows only

    def save(self, path: Path, key: str) -> None:
        """Write an npz file; `key` says what the drops were made from."""
        arrays = {name: value for name, value in vars(self).items() if value is not None}
        with replacing(path) as temporary:
            np.savez(temporary, key=np.array(key), **arrays)

    @classmethod
    def load(cls, path: Path) -> tuple["DropBank", str]:
        """The drops that `save` wrote, and their key.

        Raises:
            InputError: the file is missing or damaged.
        """
        try:
            parts = load_arrays(path)
            key = str(parts.pop("key"))
            needed = {field.name for field in fields(cls)} - {"sky"}
            return cls(**{name: parts[name] for name in needed}, sky=parts.get("sky")), key
        except UNREADABLE as error:
            raise damaged(path, error) from error


def cut(
    traced: dict[str, NDArray],
    margin: tuple[int, int],
    bodies: int,
    body_at: Callable[[NDArray[np.float64]], NDArray[np.int64]],
    sky: Plane | None = None,
) -> DropBank:
    """Cut a lens into its bodies of water.

    Args:
        traced: the lens as `bake.bake_paths` returns it, with a margin around the picture.
        margin: its columns and rows on each side.
        bodies: S, how many there are.
        body_at: the body at places [N, 2] of the lens, pixels from its upper left corner.
        sky: of windows, as for `path_matte.assemble`.
    """
    height, width = traced["cover"].shape
    through = np.bincount(traced["pixel"], traced["throughput"], minlength=height * width)
    cover = traced["cover"].ravel()
    wet = np.flatnonzero((cover > 0) | (through > 0))
    body = body_at(np.column_stack([wet % width + 0.5, wet // width + 0.5]))
    order = np.argsort(body, kind="stable")
    wet, body = wet[order], body[order]
    row = np.empty(height * width, np.int64)
    row[wet] = np.arange(len(wet))
    wide, high = (2 * BEYOND + 1) * width, (2 * BEYOND + 1) * height
    rows, columns, weights = [], [], []
    for x, y, share in corners(traced["place"]):
        rows.append(row[traced["pixel"]])
        columns.append((y + BEYOND * height) * wide + x + BEYOND * width)
        weights.append((traced["throughput"] * share).astype(np.float32))
    entries = (np.concatenate(weights), (np.concatenate(rows), np.concatenate(columns)))
    paths = csr_array(entries, shape=(len(wet), wide * high))  # adds up what falls on the same pixel
    from_picture = np.array(margin) + np.array([BEYOND * width, BEYOND * height])
    ends = np.column_stack([paths.indices % wide, paths.indices // wide]) - from_picture
    pixels = np.column_stack([wet % width, wet // width]) - margin
    small = np.int16 if (2 * BEYOND + 1) * max(width, height) < np.iinfo(np.int16).max else np.int32
    return DropBank(
        starts=np.searchsorted(body, np.arange(bodies + 1)),
        pixels=pixels.astype(small),
        cover=cover[wet].astype(np.float32),
        ambient=np.maximum(cover - through, 0)[wet].astype(np.float32),
        path_starts=paths.indptr.astype(np.int64),
        ends=ends.astype(small),
        weights=paths.data.astype(np.float32),
        sky=None if sky is None else sky.ravel()[wet].astype(np.float32),
    )


class DropPainter:
    """Drops in front of one picture, painted one after another, in focus."""

    def __init__(self, light: Image) -> None:
        """Nothing yet in front of a picture [H, W, 3] of linear light."""
        height, width = light.shape[:2]
        self.mask = np.zeros((height, width), np.float32)  # M, their cover
        self.radiance = np.zeros((height, width, 3), np.float32)  # D, their light
        self.sky = np.zeros((height, width), np.float32)  # the part of it that is bright of its own
        self._light = np.ascontiguousarray(light, np.float32)
        self._mean = light.mean(axis=(0, 1), dtype=np.float64)
        self._folds = [mirrored(np.arange(-BEYOND * n, (BEYOND + 1) * n), n).astype(np.int32) for n in (width, height)]

    def paint(self, bank: DropBank, slots: NDArray[np.int64], shift: tuple[int, int]) -> None:
        """Add bodies of a bank, moved by whole pixels right and down; where there is water already, it hides them."""
        sky = np.zeros_like(bank.cover) if bank.sky is None else bank.sky
        lens = (bank.starts, bank.pixels, bank.cover, bank.ambient, bank.path_starts, bank.ends, bank.weights, sky)
        layers = (self.mask, self.radiance, self.sky)
        _paint(slots, lens, shift, self._light, self._mean, self._folds[0], self._folds[1], layers)


@numba.njit(cache=True, nogil=True)
def _paint(slots, lens, shift, light, mean, fold_x, fold_y, layers):  # type: ignore[no-untyped-def]
    starts, pixels, cover, ambient, path_starts, ends, weights, sky = lens
    mask, radiance, bright = layers
    height, width = mask.shape
    right, down = shift[0], shift[1]
    to_x, to_y = right + BEYOND * width, down + BEYOND * height
    for slot in slots:
        for p in range(starts[slot], starts[slot + 1]):
            x, y = pixels[p, 0] + right, pixels[p, 1] + down
            if x < 0 or x >= width or y < 0 or y >= height:
                continue
            red, green, blue = ambient[p] * mean[0], ambient[p] * mean[1], ambient[p] * mean[2]
            for n in range(path_starts[p], path_starts[p + 1]):
                u, v = fold_x[ends[n, 0] + to_x], fold_y[ends[n, 1] + to_y]
                red += weights[n] * light[v, u, 0]
                green += weights[n] * light[v, u, 1]
                blue += weights[n] * light[v, u, 2]
            clear = 1 - mask[y, x]
            mask[y, x] += clear * cover[p]
            bright[y, x] += clear * sky[p]
            radiance[y, x, 0] += clear * red
            radiance[y, x, 1] += clear * green
            radiance[y, x, 2] += clear * blue
