"""Which effects there are, found by name, and the patterns of them that a user names."""

from collections.abc import Sequence
from functools import cache

from hydroviews.cli.plugins import load_plugin, registered
from hydroviews.errors import InputError, unknown_name
from hydroviews.rain.effect import Effect
from hydroviews.rain.patterns import GRADES, Pattern

GROUP = "hydroviews.effects"  # entry points: subclasses of Effect
DEFAULT_EFFECTS = ("raindrop", "streak")  # drops and streaks, the two that the paper has


@cache
def registered_effects() -> dict[str, str]:
    """`package.module:Class` of every registered effect, by its name."""
    return registered(GROUP)


def find_effect(name: str) -> Effect:
    """The effect of a registered name, or of `package.module:Class`.

    Names of effects are parts of folders' names, so `package.module.Class` is the same as with a colon.

    Raises:
        InputError: no such effect.
    """
    own = name if "." not in name.strip(".") else ":".join(name.replace(":", ".").rsplit(".", 1))
    target = registered_effects().get(name, own)
    found = load_plugin(f"effect {name}", target, GROUP, "effect", "Class")
    if not (isinstance(found, type) and issubclass(found, Effect)):
        raise InputError(f"{name}: not an effect", found=found, expected="a subclass of hydroviews.rain.effect.Effect")
    return found()


def pattern_names() -> list[str]:
    """Light, medium and heavy patterns of all registered effects."""
    return [f"{effect}-{level}" for effect in registered_effects() for level in range(len(GRADES))]


def parse_pattern(name: str) -> Pattern:
    """The pattern of that name, such as raindrop-0 or package.module:Class-0.

    Raises:
        InputError: not an effect and a number.
    """
    effect, _, index = name.replace(":", ".").rpartition("-")
    if not index.isdecimal() or not (effect in registered_effects() or "." in effect):
        own = "package.module:Class-0 for your own"
        raise unknown_name(f"PATTERNS={name}", name, "rain pattern", pattern_names(), own)
    find_effect(effect)  # raises what is wrong with one's own
    return Pattern(effect, int(index))


def choose_patterns(
    names: Sequence[str], indices: Sequence[int], effects: Sequence[str] = DEFAULT_EFFECTS
) -> list[Pattern]:
    """The named patterns, or those of the given numbers of every effect where none is named."""
    if names:
        return [parse_pattern(name) for name in dict.fromkeys(names)]
    return [parse_pattern(f"{effect}-{index}") for effect in effects for index in indices]
