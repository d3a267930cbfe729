"""A pattern is one rain: its effect, its number and the seed fix everything that is drawn."""

from collections.abc import Sequence
from dataclasses import dataclass

from hydroviews.errors import InputError

EFFECTS = ("raindrop", "streak", "storm")
DEFAULT_EFFECTS = ("raindrop", "streak")  # the paper's
GRADES = ("light", "medium", "heavy")


@dataclass(frozen=True, order=True)
class Pattern:
    """One of several rains of an effect; its name is also its folder's."""

    effect: str
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


def parse_pattern(name: str) -> Pattern:
    """The pattern of that name.

    Raises:
        InputError: not an effect and a number.
    """
    effect, _, index = name.rpartition("-")
    if effect not in EFFECTS or not index.isdecimal():
        raise InputError(
            f"PATTERNS={name}: no such rain pattern",
            expected=f"an effect ({', '.join(EFFECTS)}) and a number, such as raindrop-0 or streak-2",
        )
    return Pattern(effect, int(index))


def choose_patterns(
    names: Sequence[str], indices: Sequence[int], effects: Sequence[str] = DEFAULT_EFFECTS
) -> list[Pattern]:
    """The named patterns, or those of the given numbers of every effect where none is named."""
    if names:
        return [parse_pattern(name) for name in dict.fromkeys(names)]
    return [Pattern(effect, index) for effect in effects for index in indices]
