"""Rain on one view: the layers that are added, and the picture that results.

The same function that builds a rainy view re-derives it from what is on disk, so layers are rounded to the
half floats of their files before they are used.
"""

from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from hydroviews.rain import severity
from hydroviews.rain.lens import effect as raindrops
from hydroviews.rain.lens import pattern as drops_pattern
from hydroviews.rain.patterns import Pattern
from hydroviews.rain.scene_statistics import SceneStatistics
from hydroviews.rain.seeds import generator
from hydroviews.rain.storm import effect as storm
from hydroviews.rain.streaks import effect as streaks
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import Image, to_linear, to_srgb
from hydroviews.scene.scenes import View

Layers = dict[str, NDArray[np.float32]]  # planes [H, W] by channel name


class Effect(Protocol):
    """A pattern ready to rain on the views of one scene."""

    parameters: dict[str, Any]  # everything drawn, as JSON

    def layers(self, clean: Image, view: View) -> Layers:
        """What falls on this view."""
        ...


def draw(pattern: Pattern, setting: SceneStatistics) -> Any:
    """The parameters of a pattern, from its seed, as hard on this scene as its grade says."""
    rng = generator(setting.seed, setting.scene, pattern.effect, pattern.index)
    if pattern.effect == "streak":
        return severity.grade_streaks(streaks.draw_pattern(rng, pattern.level), pattern.grade, setting)
    if pattern.effect == "storm":
        return storm.draw_pattern(rng, pattern.level)
    lens = replace(drops_pattern.draw_pattern(rng, pattern.level), lens_renderer=setting.lens_renderer)
    return severity.grade_raindrops(lens, pattern.grade, setting)


def prepare(pattern: Pattern, drawn: Any, setting: SceneStatistics, camera: Camera, folder: Path) -> Effect:
    """Make ready for views of this size and these intrinsics; what Blender bakes for them is kept in `folder`."""
    if pattern.effect == "streak":
        return Streaks(drawn, setting, pattern)
    if pattern.effect == "storm":
        return storm.Storm(drawn, setting)
    return raindrops.Raindrops(drawn, setting, camera, folder)


class Streaks:
    """Fresh streaks for every view; parameters and angle shared."""

    def __init__(self, drawn: streaks.StreakPattern, setting: SceneStatistics, pattern: Pattern) -> None:
        self.parameters = asdict(drawn)
        self._drawn, self._seed = drawn, setting.seed
        self._labels = (setting.scene, pattern.effect, pattern.index)

    def layers(self, clean: Image, view: View) -> Layers:
        """Channel S: cover of the view by streaks."""
        height, width = clean.shape[:2]
        rng = generator(self._seed, *self._labels, view.name)
        return {"S": streaks.streak_layer(self._drawn, width, height, rng)}


def rain_on(effect: Effect, clean: Image, view: View) -> Layers:
    """The layers of a view as their file holds them, rounded to half floats."""
    layers = effect.layers(clean, view)
    return {name: plane.astype(np.float16).astype(np.float32) for name, plane in layers.items()}


def composite(effect: str, parameters: Mapping[str, Any], clean: Image, layers: Layers) -> Image:
    """The rainy view.

    Streaks follow the paper's recipe in encoded values, B (1 - S) + beta S. Water on the lens and rain in space
    dim and add linear light, B (1 - M) (1 - V) + D: the paper's Eq. 2 with the cover 1 - (1 - M) (1 - V).

    Args:
        effect: "streak", "raindrop" or "storm".
        parameters: of the pattern.
        clean: B [H, W, 3], sRGB-encoded, [0, 1].
        layers: of this view.

    Returns:
        [H, W, 3], sRGB-encoded, [0, 1].
    """
    if effect == "streak":
        return streaks.composite(clean, layers["S"], parameters["brightness"])
    added = np.stack([layers[c] for c in "RGB"], axis=-1)
    passing = (1 - layers["M"]) * (1 - layers["V"])
    return to_srgb(to_linear(clean) * passing[..., None] + added)
