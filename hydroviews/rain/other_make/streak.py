"""Falling rain of another make, as an effect: A is cover by streaks, H by a veil, both in the colour of the sky."""

import logging
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from hydroviews.errors import InputError
from hydroviews.rain.compositing import LayerPlane, Layers
from hydroviews.rain.effect import Effect
from hydroviews.rain.other_make.rainfall import (
    RainfallPattern,
    draw_pattern,
    draw_rainfall,
    fall_direction,
    rain_over,
    sky_colour,
    veil_cover,
)
from hydroviews.rain.other_make.severity import grade_rainfall
from hydroviews.rain.patterns import Pattern, pattern_generator
from hydroviews.rain.scene_statistics import SceneStatistics
from hydroviews.rain.storm.world import up_direction
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import Image
from hydroviews.scene.scenes import View

logger = logging.getLogger(__name__)

Direction = NDArray[np.float64]  # unit vector [3]


class OtherStreaks(Effect):
    """`streak-b`: a veil, then strokes, both in the colour of the view's sky, in encoded values."""

    planes: ClassVar = {
        "A": LayerPlane("cover by streaks", "streaks"),
        "H": LayerPlane("cover by the veil", "mist"),
    }
    falling = "A"
    needed = ("screen",)
    words: ClassVar = {
        "strokes": "{:.0f} strokes a picture",
        "length": "near ones {:.2f} picture sides long",
        "opacity": "of a mean opacity of {:.2f}",
        "veil": "a veil that hides up to {:.1%}",
        "screen": "screen blend: {}",
    }

    def draw(self, pattern: Pattern, statistics: SceneStatistics) -> RainfallPattern:
        """Sizes, wind and blend from the seed; strokes and veil by the grade."""
        drawn = draw_pattern(pattern_generator(pattern, statistics))
        down = down_direction(statistics)
        first = statistics.views[0].camera
        falls = [fall_in(drawn, view.camera, first, down) for view in statistics.sampled_views]
        return grade_rainfall(drawn, pattern.grade, statistics, falls)

    def place(self, drawn: RainfallPattern, pattern: Pattern, statistics: SceneStatistics) -> "Rainfall":
        """The rain over the scene, falling down where it is known which way that is."""
        return Rainfall(drawn, pattern, statistics)

    def composite(self, parameters: Mapping[str, Any], clean: Image, layers: Layers) -> Image:
        """See `rainfall.rain_over`."""
        return rain_over(clean, layers["A"], layers["H"], parameters["screen"], sky_colour(clean))


class Rainfall:
    """A pattern on one scene."""

    def __init__(self, drawn: RainfallPattern, pattern: Pattern, statistics: SceneStatistics) -> None:
        self._drawn, self._pattern, self._statistics = drawn, pattern, statistics
        self._down = down_direction(statistics)
        known = None if self._down is None else [round(float(v), 6) for v in self._down]
        self.parameters: dict[str, Any] = {**asdict(drawn), "down": known}

    def prepare(self, camera: Camera, folder: Path) -> "Rainfall":
        """Ready for views of every size."""
        return self

    def layers(self, clean: Image, view: View) -> Layers:
        """Planes A and H of a view."""
        fall = fall_in(self._drawn, view.camera, self._statistics.views[0].camera, self._down)
        rng = pattern_generator(self._pattern, self._statistics, view.name)
        streaks = draw_rainfall(self._drawn, view.camera, fall, rng)
        return {"A": streaks, "H": veil_cover(self._drawn, view.camera.width, view.camera.height)}


def down_direction(statistics: SceneStatistics) -> Direction | None:
    """Down in the scene; None where cameras do not tell: rain falls down every picture then, and parameters say so."""
    try:
        return -up_direction(statistics.views)
    except InputError as error:
        logger.warning("%s: rain falls down the pictures: %s", statistics.scene, str(error).splitlines()[0])
        return None


def fall_in(drawn: RainfallPattern, camera: Camera, first: Camera, down: Direction | None) -> Direction:
    """The direction of the fall in a camera's axes; wind blows relative to where the first camera looks."""
    if down is None:
        return fall_direction(drawn, np.array([0.0, 1, 0]), np.array([0.0, 0, 1]))
    ahead = first.rotation[2] if abs(first.rotation[2] @ down) < 0.99 else -first.rotation[1]
    return np.asarray(camera.rotation @ fall_direction(drawn, down, ahead))
