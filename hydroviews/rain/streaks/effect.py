"""Falling rain by the paper's recipe, as an effect: fresh streaks in every view, parameters and angle shared."""

from collections.abc import Mapping
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any, ClassVar

from hydroviews.rain.compositing import STREAKS, Layers
from hydroviews.rain.effect import Effect
from hydroviews.rain.patterns import Pattern, pattern_generator
from hydroviews.rain.scene_statistics import SceneStatistics
from hydroviews.rain.streaks import measures
from hydroviews.rain.streaks.recipe import StreakPattern, composite, draw_pattern, streak_layer
from hydroviews.rain.streaks.severity import grade_streaks
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import Image
from hydroviews.scene.scenes import View


class StreakEffect(Effect):
    """`streak`: S = K * N, composited in encoded values."""

    planes = STREAKS
    falling = "S"
    needed = tuple(field.name for field in fields(StreakPattern))
    words: ClassVar = {
        "n": "noise level n = {:g}",
        "length": "kernel length l = {:g} pixels",
        "angle": "angle theta = {:.1f} degrees, 90 is vertical",
        "width": "thickness w = {:g} pixels",
        "brightness": "encoded brightness {:g}",
    }

    def draw(self, pattern: Pattern, statistics: SceneStatistics) -> StreakPattern:
        """l and w of the grade's part of the paper's ranges; n and if need be brightness that cost what it says."""
        drawn = draw_pattern(pattern_generator(pattern, statistics), pattern.level)
        return grade_streaks(drawn, pattern.grade, statistics)

    def place(self, drawn: StreakPattern, pattern: Pattern, statistics: SceneStatistics) -> "Streaks":
        """Ignores the scene's statistics: only its name seeds the drawing."""
        return Streaks(drawn, pattern, statistics)

    def composite(self, parameters: Mapping[str, Any], clean: Image, layers: Layers) -> Image:
        """See `recipe.composite`."""
        return composite(clean, layers["S"], parameters["brightness"])

    def seed_density(self, parameters: Mapping[str, Any], layers: Layers) -> float | None:
        """See `measures.seed_density`."""
        return measures.seed_density(layers["S"], StreakPattern(**{name: parameters[name] for name in self.needed}))


class Streaks:
    """A pattern of streaks on one scene."""

    def __init__(self, drawn: StreakPattern, pattern: Pattern, statistics: SceneStatistics) -> None:
        self.parameters = asdict(drawn)
        self._drawn, self._pattern, self._statistics = drawn, pattern, statistics

    def prepare(self, camera: Camera, folder: Path) -> "Streaks":
        """Ready for views of every size."""
        return self

    def layers(self, clean: Image, view: View) -> Layers:
        """Channel S: cover of the view by streaks."""
        height, width = clean.shape[:2]
        rng = pattern_generator(self._pattern, self._statistics, view.name)
        return {"S": streak_layer(self._drawn, width, height, rng)}
