"""A complete effect in one file: snow. Soft white flakes, new in every view.

    hydroviews build courtyard --patterns examples.snow:Snow-1
    make eval METHOD=3dgs PATTERNS=examples.snow:Snow-1

An effect has three parts: parameters drawn once per pattern, layers computed once per view, and an equation that
composites the layers over the clean view. Files, checks, contact sheets, data cards and tables use these parts.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from hydroviews.rain.compositing import LayerPlane, Layers
from hydroviews.rain.effect import Effect
from hydroviews.rain.patterns import Pattern, pattern_generator
from hydroviews.rain.scene_statistics import SceneStatistics
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import Image
from hydroviews.scene.scenes import View

FLAKES = (200, 600, 1500)  # number per picture: light, medium, heavy


@dataclass(frozen=True)
class SnowPattern:
    """All parameters that are drawn once per pattern, for `pattern.json`."""

    flakes: int  # mean number per picture
    radius: float  # standard deviation of a flake, as a share of the geometric mean of width and height
    white: float  # encoded value of a flake


class Snow(Effect):
    """Snow: R = (1 - A) B + A white, in sRGB-encoded values."""

    planes: Mapping[str, LayerPlane] = {"A": LayerPlane("cover by snow", "streaks")}
    needed = ("white",)  # by `composite`
    words: Mapping[str, str] = {"flakes": "{} flakes a picture"}

    def draw(self, pattern: Pattern, statistics: SceneStatistics) -> SnowPattern:
        """See Effect."""
        rng = pattern_generator(pattern, statistics)
        return SnowPattern(FLAKES[pattern.level], float(rng.uniform(0.004, 0.008)), float(rng.uniform(0.85, 0.95)))

    def place(self, drawn: SnowPattern, pattern: Pattern, statistics: SceneStatistics) -> "FallingSnow":
        """See Effect; snow does not depend on the scene."""
        return FallingSnow(drawn, pattern, statistics)

    def composite(self, parameters: Mapping[str, Any], clean: Image, layers: Layers) -> Image:
        """See Effect."""
        alpha = layers["A"][..., None]
        return (1 - alpha) * clean + alpha * np.float32(parameters["white"])


class FallingSnow:
    """A pattern on one scene; nothing has to be prepared."""

    def __init__(self, drawn: SnowPattern, pattern: Pattern, statistics: SceneStatistics) -> None:
        self.parameters = asdict(drawn)
        self._drawn, self._pattern, self._statistics = drawn, pattern, statistics

    def prepare(self, camera: Camera, folder: Path) -> "FallingSnow":
        """See Rain."""
        return self

    def layers(self, clean: Image, view: View) -> Layers:
        """See PreparedRain: one Gaussian per flake, at a place drawn for this view."""
        rng = pattern_generator(self._pattern, self._statistics, view.name)
        height, width = clean.shape[:2]
        sigma = self._drawn.radius * (width * height) ** 0.5  # pixels
        seeds = rng.random((height, width)) < self._drawn.flakes / (height * width)
        flakes = cv2.GaussianBlur(seeds.astype(np.float32), (0, 0), sigma) * (2 * np.pi * sigma**2)
        return {"A": np.minimum(flakes, 1).astype(np.float32)}
