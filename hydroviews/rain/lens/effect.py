"""Water on the lens as an effect: see `raindrops` for what it draws."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar

from hydroviews.rain.compositing import WATER, Layers, add_water
from hydroviews.rain.effect import Effect
from hydroviews.rain.lens.pattern import RaindropPattern, draw_pattern
from hydroviews.rain.lens.raindrops import Raindrops
from hydroviews.rain.lens.severity import grade_raindrops
from hydroviews.rain.patterns import Pattern, pattern_generator
from hydroviews.rain.scene_statistics import SceneStatistics
from hydroviews.scene.images import Image


class RaindropEffect(Effect):
    """`raindrop`: M is cover by drops, V by mist; Blender bakes drops for every size and focal length."""

    planes = WATER
    needs_optics = True
    words: ClassVar = {
        "coverage": "large drops over {:.0%} of the picture",
        "radius_median": "of a median radius of {:.3f} picture sides",
        "droplets": "{} droplets between them",
        "rivulets": "rivulets: {}",
        "mist": "mist that hides {:.0%} where it is densest",
        "key_frames": "a sequence of {} key frames",
        "lens_renderer": "drawn by {}",
    }

    def draw(self, pattern: Pattern, statistics: SceneStatistics) -> RaindropPattern:
        """A lens in rain of the grade, mist and if need be coverage set by it; one photograph has one key frame."""
        drawn = draw_pattern(pattern_generator(pattern, statistics), pattern.level)
        key_frames = drawn.key_frames if len(statistics.views) > 1 else 1
        lens = replace(drawn, lens_renderer=statistics.lens_renderer, key_frames=key_frames)
        return grade_raindrops(lens, pattern.grade, statistics)

    def place(self, drawn: RaindropPattern, pattern: Pattern, statistics: SceneStatistics) -> Raindrops:
        """The lens in front of the scene, whose air lights the mist."""
        return Raindrops(drawn, statistics)

    def composite(self, parameters: Mapping[str, Any], clean: Image, layers: Layers) -> Image:
        """See `compositing.add_water`."""
        return add_water(clean, layers)
