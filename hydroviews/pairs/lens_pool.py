"""Wet lenses that Blender bakes once, for all photographs of a size to be seen through."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array
from tqdm import tqdm

from hydroviews.pairs.photographs import LONG_SIDES, Frame, frames
from hydroviews.pairs.recipes import fields
from hydroviews.rain.lens.optics.bake import bake_matte, moment_of
from hydroviews.rain.lens.optics.path_matte import PathMatte
from hydroviews.rain.lens.patterns import pattern as drops_pattern
from hydroviews.rain.lens.patterns.mist import window_mist
from hydroviews.rain.lens.patterns.pattern import RaindropPattern
from hydroviews.rain.lens.patterns.window import BY_GRADE, WindowPattern, draw_window
from hydroviews.scene.cameras import Camera
from hydroviews.scene.seeds import generator

FOCAL = 1.2  # focal length of a photograph in long sides: what a normal lens has
LENSES = 10  # wet lenses baked for a frame; mist, photograph, flips and crops are new in every pair
WINDOWS = 6  # window panes baked for a frame; their light is new in every pair, too


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

    @cached_property
    def window_form(self) -> NDArray[np.float32]:
        """V [H, W] of a window's own mist where it is 1 at most.

        Raises:
            ValueError: the lens is no window.
        """
        if not isinstance(self.pattern, WindowPattern):
            raise ValueError("expected a window")
        height, width = self.matte.mask.shape
        return window_mist(replace(self.pattern, mist=1.0), width, height, moment_of(self.pattern, self.frame))


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
    mask, ambient = fields.halved(matte.mask), fields.halved(matte.ambient)
    sky = None if matte.sky is None else fields.halved(matte.sky)
    return PathMatte(mask, ambient, pixels, csr_array(small), matte.disk / 2, sky)


Pool = dict[Frame, tuple[WetLens, ...]]


def camera_of(frame: Frame) -> Camera:
    """A camera for a photograph of which nothing but the size is known."""
    focal = FOCAL * max(frame)
    return Camera(*frame, focal, focal, frame[0] / 2, frame[1] / 2, np.eye(4))


def bake_pool(
    folder: Path, seed: int, lenses: int = LENSES, sides: Sequence[int] = LONG_SIDES, windows: int = 0
) -> Pool:
    """Wet lenses of all grades, kept in `folder`; Blender bakes what is missing, 3 s each, 4 s a window.

    Args:
        folder: where they are kept.
        seed: of their patterns.
        lenses: for every frame.
        sides: the frames' long sides, pixels.
        windows: window panes for every frame, after the lenses.

    Raises:
        InputError: Blender failed, or a kept file is damaged.
    """
    bakes = [(bake_lens, index) for index in range(lenses)] + [(bake_window, index) for index in range(windows)]
    wanted = [(frame, bake, index) for bake, index in bakes for frame in frames(sides)]
    pool: dict[Frame, list[WetLens]] = {frame: [] for frame in frames(sides)}
    for frame, bake, index in tqdm(wanted, desc="wet lenses", unit="lens"):
        pool[frame].append(bake(folder, seed, frame, index))
    return {frame: tuple(wet) for frame, wet in pool.items()}


def bake_lens(folder: Path, seed: int, frame: Frame, index: int) -> WetLens:
    """One wet lens: grades and key frames in turn.

    Raises:
        InputError: see `bake_pool`.
    """
    rng = generator(seed, "lens", *frame, index)
    pattern = drops_pattern.draw_pattern(rng, index % len(drops_pattern.COVERAGE))
    return _baked(pattern, folder / f"{frame[0]}x{frame[1]}-{seed}-{index:03d}", frame, index)


def bake_window(folder: Path, seed: int, frame: Frame, index: int) -> WetLens:
    """One window pane: grades and key frames in turn.

    Raises:
        InputError: see `bake_pool`.
    """
    pattern = draw_window(generator(seed, "window", *frame, index), index % len(BY_GRADE))
    return _baked(pattern, folder / f"window-{frame[0]}x{frame[1]}-{seed}-{index:03d}", frame, index)


def _baked(pattern: RaindropPattern, place: Path, frame: Frame, index: int) -> WetLens:
    key_frame = index % pattern.key_frames
    return WetLens(pattern, key_frame, bake_matte(pattern, camera_of(frame), place, key_frame))
