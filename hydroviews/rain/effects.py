"""Which effects there are, found by name, and the patterns of them that a user names."""

import importlib
import os
import sys
from collections.abc import Sequence
from functools import cache
from importlib.metadata import entry_points

from hydroviews.errors import InputError
from hydroviews.rain.effect import Effect
from hydroviews.rain.patterns import Pattern

GROUP = "hydroviews.effects"  # entry points: subclasses of Effect
DEFAULT_EFFECTS = ("raindrop", "streak")  # the paper's


@cache
def registered_effects() -> dict[str, str]:
    """`package.module:Class` of every registered effect, by its name."""
    return {point.name: point.value for point in sorted(entry_points(group=GROUP), key=lambda point: point.name)}


def find_effect(name: str) -> Effect:
    """The effect of a registered name, or of `package.module:Class`.

    Names of effects are parts of folders' names, so `package.module.Class` is the same as with a colon.

    Raises:
        InputError: no such effect.
    """
    target = registered_effects().get(name) or ":".join(name.replace(":", ".").rsplit(".", 1))
    module, _, member = target.partition(":")
    if not (module and member) or module.startswith("."):
        raise InputError(f"{name}: no such effect", expected=_known())
    try:
        if os.getcwd() not in sys.path:  # one's own effect, however the command was started
            sys.path.append(os.getcwd())
        found = getattr(importlib.import_module(module), member)
    except Exception as error:  # whatever stands in a user's module
        raise InputError(f"{name}: cannot import {target}", found=f"{type(error).__name__}: {error}") from error
    if not (isinstance(found, type) and issubclass(found, Effect)):
        raise InputError(f"{name}: not an effect", found=found, expected="a subclass of hydroviews.rain.effect.Effect")
    return found()


def parse_pattern(name: str) -> Pattern:
    """The pattern of that name, such as raindrop-0 or package.module:Class-0.

    Raises:
        InputError: not an effect and a number.
    """
    effect, _, index = name.replace(":", ".").rpartition("-")
    if not index.isdecimal() or not (effect in registered_effects() or "." in effect):
        raise InputError(
            f"PATTERNS={name}: no such rain pattern",
            expected=f"an effect and a number, such as raindrop-0 or streak-2; effects are {_known()}",
        )
    find_effect(effect)  # raises what is wrong with one's own
    return Pattern(effect, int(index))


def choose_patterns(
    names: Sequence[str], indices: Sequence[int], effects: Sequence[str] = DEFAULT_EFFECTS
) -> list[Pattern]:
    """The named patterns, or those of the given numbers of every effect where none is named."""
    if names:
        return [parse_pattern(name) for name in dict.fromkeys(names)]
    return [parse_pattern(f"{effect}-{index}") for effect in effects for index in indices]


def _known() -> str:
    return f"{', '.join(registered_effects())}, or package.module:Class for your own"
