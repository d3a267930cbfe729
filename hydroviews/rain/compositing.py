"""The planes of a layer file, and the equation that puts water and light over a clean view.

Names of planes have a meaning wherever layers are read: S is blended by the paper's Eq. 1 (`streaks.recipe.composite`);
M, V, R, G and B go by its Eq. 2, `add_water`. An effect with an equation of its own gives its planes other names.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hydroviews.scene.images import Image, to_linear, to_srgb

Layers = Mapping[str, NDArray[np.float32]]  # planes [H, W] by channel name


@dataclass(frozen=True)
class LayerPlane:
    """One channel of an effect's layer files, [H, W]."""

    title: str = ""  # on contact sheets; empty: not shown alone
    share: str = ""  # water, mist or streaks: the column of the statistics that it counts for; empty: none
    least: float = 0.0  # the smallest value
    most: float = 1.0  # the largest value


COLOURS = {channel: LayerPlane(most=math.inf) for channel in "RGB"}  # linear light that is added
WATER = {"M": LayerPlane("cover by water", "water"), "V": LayerPlane("cover by mist", "mist"), **COLOURS}
STREAKS = {"S": LayerPlane("cover by streaks", "streaks")}


def light_stems(planes: Mapping[str, LayerPlane]) -> list[str]:
    """Stems of planes of added light: a stem with R, G and B names three planes. Planes of noise may be negative."""
    reds = [key for key, plane in planes.items() if key.endswith("R") and plane.least >= 0]
    return [red[:-1] for red in reds if {red[:-1] + channel for channel in COLOURS} <= planes.keys()]


def add_water(clean: Image, layers: Layers) -> Image:
    """Water on the lens or rain in space over a view: B (1 - M) (1 - V) + D in linear light.

    This is the paper's Eq. 2 with the cover 1 - (1 - M) (1 - V).

    Args:
        clean: B [H, W, 3], sRGB-encoded, [0, 1].
        layers: M, cover by drops; V, by mist; R, G, B, the light D of both.

    Returns:
        [H, W, 3], sRGB-encoded, [0, 1].
    """
    return to_srgb(water_over(to_linear(clean), layers))


def water_over(light: Image, layers: Layers) -> Image:
    """The same over linear light [H, W, 3]: linear, not clipped."""
    added = np.stack([layers[channel] for channel in "RGB"], axis=-1)
    passing = (1 - layers["M"]) * (1 - layers["V"])
    return light * passing[..., None] + added
