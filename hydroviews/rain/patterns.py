"""A pattern is one rain: its effect, its number and the seed fix everything that is drawn."""

from collections.abc import Sequence
from dataclasses import dataclass

from hydroviews.errors import InputError

EFFECTS = ("raindrop", "streak")


@dataclass(frozen=True, order=True)
class Pattern:
    """One of several rains of an effect; its name is also its folder's."""

    effect: str
    index: int

    @property
    def name(self) -> str:
        """For example `raindrop-0`."""
        return f"{self.effect}-{self.index}"


def parse_pattern(name: str) -> Pattern:
    """The pattern of that name.

    Raises:
        InputError: not an effect and a number.
    """
    effect, _, index = name.rpartition("-")
    if effect not in EFFECTS or not index.isdecimal():
        raise InputError(
            f"PATTERNS={name}: no such rain pattern", expected="an effect and a number, such as raindrop-0 or streak-2"
        )
    return Pattern(effect, int(index))


def patterns_of(count: int) -> list[Pattern]:
    """The first `count` patterns of every effect."""
    return [Pattern(effect, index) for effect in EFFECTS for index in range(count)]


def choose_patterns(names: Sequence[str], default_count: int) -> list[Pattern]:
    """The named patterns, or the first `default_count` of each effect where none is named."""
    return [parse_pattern(name) for name in dict.fromkeys(names)] if names else patterns_of(default_count)
