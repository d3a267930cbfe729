"""Mist of any form and colour, and where drops have wiped it off."""

import cv2
import numpy as np
from numpy.typing import NDArray

from hydroviews.pairs.recipes.fields import Plane, clouds, log_uniform, tinted

THICKEST = 0.95  # V where the thickest mist is densest
NO_MIST = 0.15  # share of levels that are 0
STEEP = (0.5, 6.0)  # exponents of a form: from nearly even to absent over most of a picture
SOFT = (0.001, 0.01)  # sides, standard deviation of wiped edges
COLOURED = 0.3  # share of the lights of mist that have a strong cast


def draw_level(rng: np.random.Generator) -> float:
    """V where mist is densest, [0, THICKEST]; thin mist is more frequent, and there is none in a share NO_MIST."""
    return 0.0 if rng.uniform() < NO_MIST else THICKEST * float(rng.uniform()) ** 2


def draw_thick_level(rng: np.random.Generator) -> float:
    """V where the mist of a pane is densest, from 0.1 to THICKEST, all as frequent."""
    return float(rng.uniform(0.1, THICKEST))


def draw_light(rng: np.random.Generator) -> NDArray[np.float32]:
    """The encoded light [3] of mist: grey to white, and sometimes coloured."""
    cast = rng.uniform(0.1, 0.25) if rng.uniform() < COLOURED else rng.uniform(0, 0.06)
    return tinted(rng, 1 - 0.6 * float(rng.uniform()) ** 1.3, float(cast))


def draw_veil(rng: np.random.Generator, width: int, height: int, level: float) -> Plane:
    """V [height, width] in [0, level]: smooth or steep, coarse or fine, with a slope across the picture."""
    form, side = np.zeros((height, width), np.float32), float(np.sqrt(width * height))
    for _ in range(rng.integers(1, 4)):
        form += float(rng.uniform(0.2, 1)) * clouds(rng, width, height, log_uniform(rng, 0.03, 0.5) * side)
    y, x = np.mgrid[-0.5 : 0.5 : height * 1j, -0.5 : 0.5 : width * 1j].astype(np.float32)
    slope = rng.normal(0, rng.choice((1.0, 3.0)), 2).astype(np.float32)
    form += slope[0] * x + slope[1] * y
    low, high = np.quantile(form[::4, ::4], (rng.uniform(0, 0.3), rng.uniform(0.7, 1)))
    form = np.clip((form - low) / max(high - low, 1e-6), 0, 1) ** log_uniform(rng, *STEEP)
    least = float(rng.uniform(0, 0.8)) if rng.uniform() < 0.5 else 0.0
    return np.asarray(level * (least + (1 - least) * form), np.float32)


def draw_wiped(rng: np.random.Generator, cover: Plane) -> Plane:
    """The share [H, W] of the mist that drops have taken along: around larger ones, and above those that have run.

    Args:
        rng: the generator.
        cover: by drops in focus, [H, W].
    """
    side = float(np.sqrt(cover.size))
    drops = (cover > 0.5).astype(np.uint8)
    larger = cv2.morphologyEx(drops, cv2.MORPH_OPEN, _disk(log_uniform(rng, 0.004, 0.02) * side))
    around = cv2.dilate(larger, _disk(log_uniform(rng, 0.004, 0.03) * side))
    if rng.uniform() < 0.3:
        length = int(log_uniform(rng, 0.03, 0.4) * side)
        trails = cv2.dilate(larger, np.ones((length, 1), np.uint8), anchor=(0, 0))
        around = np.maximum(around, trails)
    soft = cv2.GaussianBlur(around.astype(np.float32), (0, 0), log_uniform(rng, *SOFT) * side)
    return np.asarray(float(rng.uniform(0.5, 1)) * soft, np.float32)


def _disk(diameter: float) -> NDArray[np.uint8]:
    size = max(3, round(diameter)) | 1
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size)), np.uint8)
