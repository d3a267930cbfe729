"""What a pattern may know about the scene it rains on."""

from dataclasses import dataclass

import numpy as np
from tqdm import tqdm

from hydroviews.images import resize_area, to_linear
from hydroviews.rain.light import luminance
from hydroviews.scenes import Points, View

SAMPLED_VIEWS = 24  # spread evenly over the capture
SAMPLED_SIDE = 200  # pixels of a sampled view's longer side, at most
AIR = 90.0  # percentile of the luminance that a veil of lit mist has


@dataclass(frozen=True)
class Light:
    """How bright a scene is, in linear light, measured over its clean views."""

    mean: tuple[float, float, float]
    air: tuple[float, float, float]  # mean colour of the brightest tenth: what mist and distant rain scatter


@dataclass(frozen=True)
class Setting:
    """A scene about to be rained on."""

    scene: str  # its name
    seed: int
    views: tuple[View, ...]  # clean, at the built size, in order of name: taken one after another
    points: Points
    light: Light


def measure_light(views: tuple[View, ...], label: str) -> Light:
    """Mean and air light over some of the views.

    Raises:
        InputError: an unreadable picture.
    """
    chosen = views[:: -(-len(views) // SAMPLED_VIEWS)]
    pixels = []
    for view in tqdm(chosen, desc=f"{label}: light", unit="view", leave=False):
        image = view.image()
        scale = max(1.0, max(image.shape[:2]) / SAMPLED_SIDE)
        size = [max(1, round(side / scale)) for side in (image.shape[1], image.shape[0])]
        pixels.append(to_linear(resize_area(image, *size)).reshape(-1, 3))
    linear = np.concatenate(pixels)
    brightness = luminance(linear)
    bright = linear[brightness >= np.percentile(brightness, AIR)]
    return Light(_colour(linear.mean(axis=0)), _colour(bright.mean(axis=0)))


def _colour(values: np.ndarray) -> tuple[float, float, float]:
    red, green, blue = (round(float(v), 6) for v in values)
    return red, green, blue
