"""Photographs as shorter exposures in other light, and the light of their air."""

import numpy as np
from numpy.typing import NDArray

from hydroviews.pairs.photographs import Bytes
from hydroviews.rain import light
from hydroviews.rain.scene_statistics import AIR, TINT
from hydroviews.scene.images import to_linear, to_srgb

DIMMEST = 0.35  # the darkest exposure that photographs are given, in linear light
CAST = 0.1  # by how much the channels' exposures differ, at most
SPARSE = 4  # every so many rows and columns are looked at for the light of the air
LINEAR = to_linear(np.arange(256, dtype=np.float32) / 255)  # of 8-bit values


def draw_exposure(rng: np.random.Generator) -> NDArray[np.float32]:
    """Factors on linear light [3] that make of a photograph a shorter exposure in other light."""
    return np.asarray(rng.uniform(DIMMEST, 1) * rng.uniform(1 - CAST, 1, 3), np.float32)


def exposed(photograph: Bytes, exposure: NDArray[np.float32]) -> Bytes:
    """The photograph [H, W, 3] with its linear light times `exposure` [3], so that dark scenes are learned too."""
    table = np.stack([np.rint(255 * to_srgb(LINEAR * gain)) for gain in exposure], axis=1).astype(np.uint8)
    return np.stack([table[photograph[..., channel], channel] for channel in range(3)], axis=-1)


def air_light(linear: NDArray[np.float32]) -> NDArray[np.float32]:
    """The light [3] of a scene's air, from one picture of linear light: see hydroviews.rain.scene_statistics."""
    return light.air_light(linear[::SPARSE, ::SPARSE].reshape(-1, 3), AIR, TINT)
