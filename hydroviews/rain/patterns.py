"""A pattern is one rain: its effect, its number and the seed fix everything that is drawn."""

from dataclasses import dataclass

import numpy as np

from hydroviews.rain.scene_statistics import SceneStatistics
from hydroviews.scene.seeds import generator

GRADES = ("light", "medium", "heavy")
PATTERN_FILE = "pattern.json"  # of a built variant: what was drawn


@dataclass(frozen=True, order=True)
class Pattern:
    """One of several rains of an effect; its name is also its folder's."""

    effect: str  # its name, see `registry.find_effect`
    index: int

    @property
    def name(self) -> str:
        """For example `raindrop-0`."""
        return f"{self.effect}-{self.index}"

    @property
    def grade(self) -> str:
        """How hard it is: the first three patterns of an effect are light, medium and heavy, and so on in turn."""
        return GRADES[self.level]

    @property
    def level(self) -> int:
        """The grade as a number: 0 light, 1 medium, 2 heavy."""
        return self.index % len(GRADES)


def pattern_generator(pattern: Pattern, statistics: SceneStatistics, *labels: str | int) -> np.random.Generator:
    """The random generator of a pattern on a scene; further labels, such as a view's name, give independent ones."""
    return generator(statistics.seed, statistics.scene, pattern.effect, pattern.index, *labels)
