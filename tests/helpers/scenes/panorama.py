"""Views of a wide painting by a camera that turns: the scene moves over the lens, with no renderer needed."""

import cv2
import numpy as np
from numpy.typing import NDArray

from hydroviews.scene.images import to_linear, to_srgb, to_uint8

HEIGHT, WIDTH = 45, 61  # odd
Size = tuple[int, int]


def paint(seed: int = 0, size: Size = (160, 400)) -> NDArray[np.float32]:
    """A texture of large and small blobs [H, W, 3] between 0.02 and 0.8, with some black."""
    rng = np.random.default_rng(seed)
    layers = [rng.standard_normal((size[0] // c, size[1] // c, 3)).astype(np.float32) for c in (32, 8, 3)]
    texture = sum(cv2.resize(layer, size[::-1], interpolation=cv2.INTER_CUBIC) for layer in layers)
    return np.clip(0.35 + 0.2 * np.asarray(texture), 0.02, 0.8).astype(np.float32)


def views_of(
    painting: NDArray[np.float32], count: int, seed: int = 1, size: Size = (HEIGHT, WIDTH)
) -> NDArray[np.float32]:
    """What `count` views [N, H, W, 3] show: windows at random places."""
    rng = np.random.default_rng(seed)
    rows, columns = (rng.integers(0, whole - side, count) for whole, side in zip(painting.shape, size, strict=False))
    return np.stack([painting[r : r + size[0], c : c + size[1]] for r, c in zip(rows, columns, strict=True)])


def misted(views: NDArray[np.float32], alpha: NDArray, colour: NDArray) -> NDArray[np.float32]:
    """The views through mist of alpha [H, W] and linear light `colour` [3]."""
    blocked = alpha[..., None].astype(np.float32)
    return to_srgb(to_linear(views) * (1 - blocked) + blocked * np.asarray(colour, np.float32))


def shaded_drop(height: int, width: int) -> NDArray[np.float32]:
    """What a drop shows whatever is behind it [H, W, 3], 0.2 to 0.7: lit from below, and uneven across."""
    down, across = np.mgrid[:height, :width] / np.float32([max(height, width) - 1])
    shading = 0.3 + 0.3 * down + 0.1 * np.cos(30 * across)
    return np.repeat(shading[..., None], 3, axis=2).astype(np.float32)


def slanted_mist(most: float) -> NDArray[np.float32]:
    """mist_alpha [H, W] that rises from 0 at the left to `most` at the right."""
    return np.tile(np.linspace(0, most, WIDTH, dtype=np.float32), (HEIGHT, 1))


def eight_bit(views: NDArray[np.float32]) -> list[NDArray[np.uint8]]:
    """As photographs are kept."""
    return [to_uint8(view) for view in views]
