"""Water on the lens as an effect: see `raindrops` for what it draws."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from hydroviews.rain.compositing import WATER, Layers, add_water, water_over
from hydroviews.rain.effect import Effect
from hydroviews.rain.lens.optics.path_matte import defocus
from hydroviews.rain.lens.patterns.pattern import Focus, RaindropPattern, draw_pattern, fitted_to
from hydroviews.rain.lens.raindrops import Raindrops
from hydroviews.rain.lens.severity import grade_raindrops
from hydroviews.rain.patterns import Pattern, pattern_generator
from hydroviews.rain.scene_statistics import SceneStatistics
from hydroviews.scene.images import Image, to_linear, to_srgb


class RaindropEffect(Effect):
    """`raindrop`: M is cover by drops, V by mist; Blender bakes drops for every size and focal length."""

    planes = WATER
    needs_optics = True
    renewed: ClassVar[float] = 0.0  # share of the drops that are new in every view, 0 to 1
    focus: ClassVar[Focus] = "scene"  # what is sharp
    words: ClassVar[Mapping[str, str]] = {
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
        lens = replace(fitted_to(drawn, statistics), renewed=self.renewed, focus=self.focus)
        return grade_raindrops(lens, pattern.grade, statistics)

    def place(self, drawn: RaindropPattern, pattern: Pattern, statistics: SceneStatistics) -> Raindrops:
        """The lens in front of the scene, whose air lights the mist."""
        return Raindrops(drawn, statistics)

    def composite(self, parameters: Mapping[str, Any], clean: Image, layers: Layers) -> Image:
        """See `compositing.add_water`; behind drops in focus the view is blurred, R = (1 - M) (1 - V) blur(B) + D.

        Lamps are blurred as bright as the camera recorded them: given back their light, petals would turn white.
        """
        if parameters.get("focus", "scene") == "scene":
            return add_water(clean, layers)
        disk = parameters["focus_blur"] * float(np.sqrt(clean.shape[0] * clean.shape[1]))
        return to_srgb(water_over(defocus(to_linear(clean), disk), layers))


class RenewedRaindropEffect(RaindropEffect):
    """`raindrop-renewed`: half of the drops are new in every view."""

    renewed = 0.5
    words: ClassVar = {**RaindropEffect.words, "renewed": "{:.0%} of the drops new in every view"}


class SharpRaindropEffect(RaindropEffect):
    """`raindrop-sharp`: the lens is focused on the drops, the scene behind them is blurred."""

    focus = "drops"
    needed = ("focus", "focus_blur")
    words: ClassVar = {**RaindropEffect.words, "focus_blur": "a scene blurred by a disk of {:.3f} picture sides"}
