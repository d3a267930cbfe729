"""A photograph and a wet lens made on the spot."""

import numpy as np
from scipy.sparse import csr_array

from hydroviews.pairs.lens_pool import WetLens
from hydroviews.rain.lens.optics.path_matte import PathMatte, dry
from hydroviews.rain.lens.patterns.pattern import draw_pattern

WIDTH, HEIGHT = 96, 64


def photograph(seed: int = 0, height: int = HEIGHT, width: int = WIDTH) -> np.ndarray:
    coarse = np.random.default_rng(seed).integers(20, 235, (height // 8, width // 8, 3))
    return coarse.repeat(8, 0).repeat(8, 1).astype(np.uint8)


def lens(drops: bool = True, height: int = HEIGHT, width: int = WIDTH) -> WetLens:
    """A lens with one square drop that shows the picture's first pixel, or none."""
    pattern = draw_pattern(np.random.default_rng(0))
    if not drops:
        return WetLens(pattern, 0, dry(height, width))
    mask = np.zeros((height, width), np.float32)
    mask[20:40, 30:50] = 1
    pixels = np.flatnonzero(mask)
    paths = csr_array((np.ones(len(pixels), np.float32), (np.arange(len(pixels)), np.zeros(len(pixels), int))))
    paths = csr_array((paths.data, paths.indices, paths.indptr), shape=(len(pixels), mask.size))
    return WetLens(pattern, 0, PathMatte(mask, np.zeros_like(mask), pixels, paths, 0.0))
