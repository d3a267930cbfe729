"""Wet lenses that Blender bakes once, for all photographs of a size to be seen through."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np
from scipy.sparse import coo_array, csr_array
from tqdm import tqdm

from hydroviews.pairs.photographs import LONG_SIDES, Frame, frames
from hydroviews.rain.lens.optics.bake import bake_matte
from hydroviews.rain.lens.optics.path_matte import PathMatte
from hydroviews.rain.lens.patterns import pattern as drops_pattern
from hydroviews.rain.lens.patterns.pattern import RaindropPattern
from hydroviews.scene.cameras import Camera
from hydroviews.scene.seeds import generator

FOCAL = 1.2  # focal length of a photograph in long sides: what a normal lens has
LENSES = 10  # wet lenses baked for a frame; mist, photograph, flips and crops are new in every pair


@dataclass(frozen=True, eq=False)
class WetLens:
    """Drops baked for a frame, and the pattern they are of."""

    pattern: RaindropPattern
    frame: int  # key frame
    matte: PathMatte

    @cached_property
    def half(self) -> PathMatte:
        """For companions, which are half as wide and high."""
        return halved(self.matte)


def halved(matte: PathMatte) -> PathMatte:
    """What the drops do to pictures of half the width and height, by averages of 2x2 pixels.

    Raises:
        ValueError: an odd width or height.
    """
    height, width = matte.mask.shape
    if height % 2 or width % 2:
        raise ValueError(f"expected an even width and height, found {width}x{height}")
    half = (np.arange(height)[:, None] // 2 * (width // 2) + np.arange(width) // 2).ravel()  # each pixel's
    pixels, row = np.unique(half[matte.pixels], return_inverse=True)
    paths = matte.paths.tocoo()
    entries = (paths.data / 4, (row[paths.row], half[paths.col]))
    small = coo_array(entries, shape=(len(pixels), height * width // 4)).tocsr()
    planes = (matte.mask, matte.ambient)
    smaller = (cv2.resize(plane, (width // 2, height // 2), interpolation=cv2.INTER_AREA) for plane in planes)
    mask, ambient = (np.asarray(plane, np.float32) for plane in smaller)
    return PathMatte(mask, ambient, pixels, csr_array(small), matte.disk / 2)


Pool = dict[Frame, tuple[WetLens, ...]]


def camera_of(frame: Frame) -> Camera:
    """A camera for a photograph of which nothing but the size is known."""
    focal = FOCAL * max(frame)
    return Camera(*frame, focal, focal, frame[0] / 2, frame[1] / 2, np.eye(4))


def bake_pool(folder: Path, seed: int, lenses: int = LENSES, sides: Sequence[int] = LONG_SIDES) -> Pool:
    """Wet lenses of all grades, kept in `folder`; Blender bakes what is missing, 3 s each.

    Args:
        folder: where they are kept.
        seed: of their patterns.
        lenses: for every frame.
        sides: the frames' long sides, pixels.

    Raises:
        InputError: Blender failed, or a kept file is damaged.
    """
    wanted = [(frame, index) for index in range(lenses) for frame in frames(sides)]
    pool: dict[Frame, list[WetLens]] = {frame: [] for frame in frames(sides)}
    for frame, index in tqdm(wanted, desc="wet lenses", unit="lens"):
        pool[frame].append(bake_lens(folder, seed, frame, index))
    return {frame: tuple(wet) for frame, wet in pool.items()}


def bake_lens(folder: Path, seed: int, frame: Frame, index: int) -> WetLens:
    """One wet lens: grades and key frames in turn.

    Raises:
        InputError: see `bake_pool`.
    """
    rng = generator(seed, "lens", *frame, index)
    pattern = drops_pattern.draw_pattern(rng, index % len(drops_pattern.COVERAGE))
    key_frame = index % pattern.key_frames
    place = folder / f"{frame[0]}x{frame[1]}-{seed}-{index:03d}"
    return WetLens(pattern, key_frame, bake_matte(pattern, camera_of(frame), place, key_frame))
