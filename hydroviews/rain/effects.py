"""Rain on one view: the layers that are added, and the picture that results.

The same function that builds a rainy view re-derives it from what is on disk, so layers are rounded to the
half floats of their files before they are used.
"""

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from hydroviews.cameras import Camera
from hydroviews.images import Image, to_linear, to_srgb
from hydroviews.rain import raindrops, streaks
from hydroviews.rain.patterns import Pattern
from hydroviews.rain.seeds import generator

Layers = dict[str, NDArray[np.float32]]  # planes [H, W] by channel name


class Effect(Protocol):
    """A pattern ready to rain on the views of one scene."""

    parameters: dict[str, Any]  # everything drawn, as JSON

    def layers(self, clean: Image, view: str) -> Layers:
        """What falls on this view, rounded to half floats."""
        ...


def prepare(pattern: Pattern, scene: str, seed: int, camera: Camera, folder: Path) -> Effect:
    """Draw the pattern's parameters; bake in Blender what all views of this camera share, kept in `folder`."""
    rng = generator(seed, scene, pattern.effect, pattern.index)
    if pattern.effect == "streak":
        return Streaks(streaks.draw_pattern(rng), seed, (scene, pattern.effect, pattern.index))
    return Raindrops(raindrops.draw_pattern(rng), camera, folder)


class Streaks:
    """Fresh streaks for every view; parameters and angle shared."""

    def __init__(self, pattern: streaks.StreakPattern, seed: int, labels: tuple[str | int, ...]) -> None:
        self.pattern = pattern
        self.parameters = asdict(pattern)
        self._seed, self._labels = seed, labels

    def layers(self, clean: Image, view: str) -> Layers:
        """Channel S: cover of the view by streaks."""
        height, width = clean.shape[:2]
        rng = generator(self._seed, *self._labels, view)
        return _half({"S": streaks.streak_layer(self.pattern, width, height, rng)})


class Raindrops:
    """Drops that stay on the lens; what they show changes with the view."""

    def __init__(self, pattern: raindrops.RaindropPattern, camera: Camera, folder: Path) -> None:
        self.parameters = asdict(pattern)
        self._matte = raindrops.bake_matte(pattern, camera, folder)

    def layers(self, clean: Image, view: str) -> Layers:
        """Channels M: cover by drops; R, G, B: the linear radiance of the drops."""
        radiance = self._matte.apply(to_linear(clean))
        return _half({"M": self._matte.mask, **{c: radiance[..., i] for i, c in enumerate("RGB")}})


def _half(layers: Mapping[str, NDArray]) -> Layers:
    return {name: plane.astype(np.float16).astype(np.float32) for name, plane in layers.items()}


def composite(effect: str, parameters: Mapping[str, Any], clean: Image, layers: Layers) -> Image:
    """The rainy view: streaks in encoded values, B (1 - S) + beta S; drops in linear light, B (1 - M) + D (Eq. 2).

    Args:
        effect: "streak" or "raindrop".
        parameters: of the pattern.
        clean: B [H, W, 3], sRGB-encoded, [0, 1].
        layers: of this view.

    Returns:
        [H, W, 3], sRGB-encoded, [0, 1].
    """
    if effect == "streak":
        return streaks.composite(clean, layers["S"], parameters["brightness"])
    radiance = np.stack([layers[c] for c in "RGB"], axis=-1)
    return to_srgb(to_linear(clean) * (1 - layers["M"][..., None]) + radiance)
