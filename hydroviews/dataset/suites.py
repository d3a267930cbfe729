"""Many scenes in one call: which captures, which effects on each, and what became of them."""

import logging
import tomllib
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from hydroviews.captures import catalogue
from hydroviews.dataset.sources import build_source
from hydroviews.errors import InputError, unknown_name
from hydroviews.files.atomic import is_there
from hydroviews.profiles import Profile
from hydroviews.rain.registry import choose_patterns, find_effect

logger = logging.getLogger(__name__)

FOLDER = Path(catalogue.__file__).parent / "suites"
KEYS = {"title", "patterns", "scenes"}
DEVELOPMENT, TEST = "development", "test"  # suites: settings are chosen on the one, and judged on the other
EXAMPLE = '[scenes] with lines such as "mipnerf360/garden" = ["raindrop", "streak"], and perhaps patterns = [0, 1, 2]'


@dataclass(frozen=True)
class Suite:
    """Scenes and the effects that each is built with."""

    title: str
    patterns: tuple[int, ...] | None  # numbers of each effect's patterns; None: the profile's
    scenes: dict[str, tuple[str, ...]]  # effects by the capture's name or folder, in order


def known_suites() -> list[str]:
    """The suites that come with the package."""
    return sorted(path.stem for path in FOLDER.glob("*.toml"))


@cache
def suite_of(scene: str) -> str:
    """DEVELOPMENT or TEST for a built scene that one of them lists, by its name; empty for any other."""
    listed = {suite: read_suite(suite).scenes for suite in (DEVELOPMENT, TEST)}
    return next((suite for suite, scenes in listed.items() if scene in map(_built_name, scenes)), "")


def _built_name(source: str) -> str:
    return source.replace("/", "_")


def read_suite(name: str) -> Suite:
    """A suite of the package by its name, or one of your own from a TOML file.

    Raises:
        InputError: neither a name nor a file, or not a suite.
    """
    path = FOLDER / f"{name}.toml" if name in known_suites() else Path(name)
    if not is_there(path):
        raise unknown_name(f"SUITE={name}", name, "suite", known_suites(), f"a TOML file: {EXAMPLE}")
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not valid TOML", found=error, expected=EXAMPLE) from None
    return Suite(str(content.get("title", path.stem)), _patterns(path, content), _scenes(path, content))


def _patterns(path: Path, content: dict[str, Any]) -> tuple[int, ...] | None:
    patterns = content.get("patterns")
    if patterns is None:
        return None
    if not (isinstance(patterns, list) and patterns and all(type(n) is int and n >= 0 for n in patterns)):
        raise InputError(
            f"{path}: patterns", found=patterns, expected="a list of numbers from 0, or no patterns at all"
        )
    return tuple(patterns)


def _scenes(path: Path, content: dict[str, Any]) -> dict[str, tuple[str, ...]]:
    if set(content) - KEYS or not isinstance(content.get("scenes"), dict) or not content["scenes"]:
        raise InputError(f"{path}: not a suite", found=", ".join(content) or "nothing", expected=EXAMPLE)
    for scene, effects in content["scenes"].items():
        if not (isinstance(effects, list) and all(isinstance(effect, str) for effect in effects)):
            raise InputError(f"{path}: effects of {scene}", found=effects, expected=f"a list; {EXAMPLE}")
        for effect in effects:
            try:
                find_effect(effect)
            except InputError as error:
                raise InputError(f"{path}: effects of {scene}", found=error) from None
    return {scene: tuple(effects) for scene, effects in content["scenes"].items()}


def build_suite(
    suite: Suite,
    out: Path,
    profile: Profile,
    *,
    captures: Path | None = None,
    seed: int | None = None,
    overwrite: bool = False,
    repair: bool = False,
    render: bool = False,
) -> dict[str, InputError]:
    """Build every scene of a suite; one that cannot be built does not hold up the others.

    Args:
        suite: see `read_suite`.
        out: the data folder; what is finished there is kept.
        profile: sizes, and patterns where the suite names none.
        captures: see `sources.find_capture`.
        seed: of the rain; a scene that is already there keeps its own if None.
        overwrite: drop scenes that were built from other requests.
        repair: make changed files of finished scenes again.
        render: see `sources.find_capture`.

    Returns:
        What kept scenes from being built, by their names: empty when all is there.
    """
    failures = {}
    numbers = profile.patterns if suite.patterns is None else suite.patterns
    for i, (scene, effects) in enumerate(suite.scenes.items(), start=1):
        logger.info("[%d/%d] %s", i, len(suite.scenes), scene)
        patterns = [pattern.name for pattern in choose_patterns((), numbers, effects)]
        try:
            build_source(
                scene,
                out,
                profile,
                patterns=patterns,
                captures=captures,
                seed=seed,
                overwrite=overwrite,
                repair=repair,
                render=render,
            )
        except InputError as error:
            logger.info("  not built: %s", str(error).splitlines()[0])
            failures[scene] = error
    return failures
