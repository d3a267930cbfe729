"""One storm seen from every camera, as an effect: see `storm` for what it draws."""

from collections.abc import Mapping
from typing import Any, ClassVar

from hydroviews.rain.compositing import WATER, Layers, add_water
from hydroviews.rain.effect import Effect
from hydroviews.rain.patterns import Pattern, pattern_generator
from hydroviews.rain.scene_statistics import SceneStatistics
from hydroviews.rain.storm.storm import Storm, StormPattern, draw_pattern
from hydroviews.scene.images import Image


class StormEffect(Effect):
    """`storm`: M is cover by single drops, V by the rain that is too fine or too far to be drawn."""

    planes = WATER
    falling = "M"
    words: ClassVar = {
        "rate": "{:.0f} mm/h",
        "density": "{:g} times the drops that Marshall and Palmer counted",
        "drops": "{:,} of them in all",
        "wind_speed": "wind of {:.1f} m/s",
        "exposure": "shutter open {:.4f} s",
        "metres_per_unit": "a unit of the capture is {:.3g} m",
    }

    def draw(self, pattern: Pattern, statistics: SceneStatistics) -> StormPattern:
        """The grade alone chooses rate, wind and shutter; storms are not adapted to the scene."""
        return draw_pattern(pattern_generator(pattern, statistics), pattern.level)

    def place(self, drawn: StormPattern, pattern: Pattern, statistics: SceneStatistics) -> Storm:
        """The storm over the scene, in metres."""
        return Storm(drawn, statistics)

    def composite(self, parameters: Mapping[str, Any], clean: Image, layers: Layers) -> Image:
        """See `compositing.add_water`."""
        return add_water(clean, layers)
