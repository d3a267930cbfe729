"""What drops on a lens do to any picture behind them: a mask, and a sparse matrix of light paths."""

import zipfile
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from hydroviews.errors import InputError
from hydroviews.files.atomic import replacing

Plane = NDArray[np.float32]
UNREADABLE = (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile, zlib.error)  # by numpy
THINNED = 3  # of the paths through a pane, every third is followed to the scene


@dataclass(frozen=True, eq=False)
class PathMatte:
    """A rainy view is R = (1 - M) B + D in linear light, with D = `apply(B)`.

    Light that reaches a drop from outside the picture's surroundings is taken to be as bright as the view's mean.
    """

    mask: Plane  # M [H, W], the drops' cover in [0, 1], defocused
    ambient: Plane  # [H, W], the part of the mask's light that no path accounts for, defocused
    pixels: NDArray[np.int64]  # [P] flat indices of the lens pixels that paths pass
    paths: csr_array  # [P, H W] weights of background pixels; rows sum to 1 at most, if not thinned
    disk: float  # diameter in pixels of the defocused image of a point on the lens
    sky: Plane | None = None  # [H, W], the part of the mask's light that is bright of its own, defocused; windows only

    def apply(self, background: NDArray[np.float32]) -> NDArray[np.float32]:
        """The radiance D [H, W, 3] that the drops add, for a picture B [H, W, 3] of linear light.

        Raises:
            ValueError: a picture of another size.
        """
        if background.shape != (*self.mask.shape, 3):
            raise ValueError(f"the drops are for pictures {(*self.mask.shape, 3)}, found {background.shape}")
        light = np.ascontiguousarray(background, np.float32).reshape(-1, 3)
        through = np.zeros_like(light)
        through[self.pixels] = self.paths @ light
        ambient = self.ambient[..., None] * light.mean(axis=0, dtype=np.float64).astype(np.float32)
        return defocus(through.reshape(background.shape), self.disk) + ambient

    def save(self, path: Path, key: str) -> None:
        """Write an npz file; `key` says what the matte was made from."""
        with replacing(path) as temporary:
            np.savez(
                temporary,
                key=np.array(key),
                mask=self.mask,
                ambient=self.ambient,
                pixels=self.pixels,
                weights=self.paths.data,
                columns=self.paths.indices,
                row_starts=self.paths.indptr,
                disk=np.array(self.disk),
                **({} if self.sky is None else {"sky": self.sky}),
            )

    @classmethod
    def load(cls, path: Path) -> tuple[Self, str]:
        """The matte that `save` wrote, and its key.

        Raises:
            InputError: the file is missing or damaged.
        """
        try:
            parts = load_arrays(path)
            shape = (len(parts["pixels"]), parts["mask"].size)
            paths = csr_array((parts["weights"], parts["columns"], parts["row_starts"]), shape=shape)
            disk, sky = float(parts["disk"]), parts.get("sky")
            matte = cls(parts["mask"], parts["ambient"], parts["pixels"], paths, disk, sky)
            return matte, str(parts["key"])
        except UNREADABLE as error:
            raise damaged(path, error) from error


def load_arrays(path: Path) -> dict[str, NDArray]:
    """All arrays of an npz file; errors are among UNREADABLE."""
    with np.load(path) as file:
        return dict(file)


def damaged(path: Path, error: Exception) -> InputError:
    """What to tell of a file of baked drops that cannot be read."""
    return InputError(f"{path}: cannot be read as baked drops", found=error, fix="remove the file; it is baked again")


def dry(height: int, width: int, *, window: bool = False) -> PathMatte:
    """The matte of a lens, or of a window, without drops."""
    nothing = np.zeros((height, width), np.float32)
    paths = csr_array((0, height * width), dtype=np.float32)
    return PathMatte(nothing, nothing, np.zeros(0, np.int64), paths, 0.0, nothing if window else None)


def assemble(
    cover: NDArray, pixel: NDArray, place: NDArray, throughput: NDArray, disk: float, sky: Plane | None = None
) -> PathMatte:
    """A matte from traced light paths.

    Args:
        cover: [H, W], the drops' cover of each lens pixel in [0, 1], in focus.
        pixel: [N], flat index of the lens pixel each path passes.
        place: [N, 2], where it comes from: x, y in pixels, beyond the borders too, where the picture is mirrored.
        throughput: [N], its share of that pixel's light.
        disk: diameter of the defocus disk in pixels.
        sky: [H, W], of windows, the bright part's share of each lens pixel's light, in focus. What shows hardly
            anything of the picture is drawn by one in THINNED paths, each of which reads one pixel instead of four.
    """
    height, width = cover.shape
    through = np.bincount(pixel, throughput, minlength=cover.size).reshape(cover.shape)
    if sky is not None:
        pixel, place, throughput = pixel[::THINNED], place[::THINNED], THINNED * throughput[::THINNED]
    pixels, row = np.unique(pixel, return_inverse=True)
    rows, columns, weights = [], [], []
    for x, y, bilinear in corners(place) if sky is None else nearest(place):
        rows.append(row)
        columns.append(mirrored(y, height) * width + mirrored(x, width))
        weights.append((throughput * bilinear).astype(np.float32))
    entries = (np.concatenate(weights), (np.concatenate(rows), np.concatenate(columns)))
    paths = csr_array(entries, shape=(len(pixels), height * width))  # adds up what falls on the same pixel
    ambient = np.maximum(cover - through, 0).astype(np.float32)
    mask = np.clip(defocus(cover.astype(np.float32), disk), 0, 1)
    bright = None if sky is None else defocus(sky, disk)
    return PathMatte(mask, defocus(ambient, disk), pixels, paths, disk, bright)


def nearest(place: NDArray) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]]:
    """The pixel x, y [N] that places [N, 2] lie in, and its share: all."""
    pixel = np.floor(place).astype(np.int64)
    yield pixel[:, 0], pixel[:, 1], np.ones(len(place))


def corners(place: NDArray) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]]:
    """The four pixels x, y [N] around places [N, 2], and their shares [N] in bilinear interpolation."""
    place = place - 0.5
    low = np.floor(place).astype(np.int64)
    share = place - low
    for dx, dy in ((0, 0), (1, 0), (0, 1), (1, 1)):
        yield low[:, 0] + dx, low[:, 1] + dy, np.abs(1 - dx - share[:, 0]) * np.abs(1 - dy - share[:, 1])


def mirrored(index: NDArray[np.int64], size: int) -> NDArray[np.int64]:
    """Indices into a row of `size` that is continued by its mirror images."""
    index = index % (2 * size)
    return np.minimum(index, 2 * size - 1 - index)


def defocus(picture: NDArray[np.float32], diameter: float) -> NDArray[np.float32]:
    """Blur [H, W] or [H, W, C] with a disk; its edge is anti-aliased, borders are mirrored."""
    if diameter <= 1:
        return picture
    fine = 8
    side = int(np.ceil(diameter)) | 1
    y, x = (np.mgrid[0 : side * fine, 0 : side * fine] + 0.5) / fine - side / 2
    inside = (np.hypot(x, y) < diameter / 2).reshape(side, fine, side, fine).mean(axis=(1, 3))
    kernel = (inside / inside.sum()).astype(np.float32)
    return np.asarray(cv2.filter2D(picture, -1, kernel, borderType=cv2.BORDER_REFLECT), np.float32)
