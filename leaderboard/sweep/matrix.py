"""The runs of a sweep: methods x scenes x patterns x seeds."""

import logging
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import pydantic
from pydantic import Field
from pydantic.dataclasses import dataclass

from baselines.method import find_method
from hydroviews.dataset.clean_views import CLEAN
from hydroviews.dataset.sources import build_source
from hydroviews.dataset.variants import has_ceiling, is_captured
from hydroviews.errors import InputError
from hydroviews.files.atomic import as_file
from hydroviews.formats.capture_json import CAPTURED
from hydroviews.profiles import Profile, find_profile
from hydroviews.rain.registry import choose_patterns
from leaderboard.evaluate import kept_record, needed_patterns
from leaderboard.records import GIVEN_POSES, check_track, in_words
from leaderboard.runs.probe import probe
from leaderboard.runs.run import CONFIG, Run, has_settings

logger = logging.getLogger(__name__)

Names = Annotated[tuple[str, ...], Field(min_length=1)]


@dataclass(frozen=True, config=pydantic.ConfigDict(extra="forbid"))
class Matrix:
    """What a sweep runs: every method on every pattern of every scene, with every seed.

    A method that learns from clean views runs on them once a scene and seed.

    Raises:
        pydantic.ValidationError: no method, no scene, no seed, or a seed below 0.
    """

    methods: Names
    scenes: Names = ("courtyard",)
    patterns: tuple[str, ...] = ()  # the profile's if none is named
    seeds: Annotated[tuple[Annotated[int, Field(ge=0)], ...], Field(min_length=1)] = (0,)
    profile: str = "demo"
    track: str = GIVEN_POSES


def matrix_of(fields: object, where: str) -> Matrix:
    """A matrix by its fields' names.

    Raises:
        InputError: fields are missing, unknown, or hold what they cannot.
    """
    try:
        return pydantic.TypeAdapter(Matrix).validate_python(fields)
    except pydantic.ValidationError as error:
        raise InputError(f"{where}: no matrix of runs", found=in_words(error), expected="methods and scenes") from None


def read_matrix(path: Path) -> Matrix:
    """The matrix of a TOML file.

    Raises:
        InputError: there is no such file, it is no TOML, or no matrix.
    """
    try:
        fields = tomllib.loads(as_file(path).read_text(encoding="utf-8-sig"))
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read", found=error, expected="a TOML file") from None
    return matrix_of(fields, str(path))


def build_runs(matrix: Matrix, data: Path, results: Path, captures: Path | None = None) -> list[Run]:
    """Build what the matrix needs and is missing.

    Returns:
        Its runs, each once, in an order in which those of one scene are together.

    Raises:
        InputError: a method, pattern or scene that there is not, or that cannot be built.
    """
    check_track(matrix.track)
    profile = find_profile(matrix.profile)
    for method in matrix.methods:
        probe(method, profile.name)
    names = [pattern.name for pattern in choose_patterns(matrix.patterns, profile.patterns)]
    runs: list[Run] = []
    for scene in matrix.scenes:
        folder = _build(scene, matrix, profile, data / profile.name, captures)
        found = [CAPTURED] if is_captured(folder) else names
        runs += [
            Run(method, profile.name, seed, folder.parent, folder.name, pattern, results, matrix.track)
            for seed in matrix.seeds
            for method in matrix.methods
            for pattern in needed_patterns(method, found)
            if pattern != CLEAN or _has_clean(method, folder)
        ]
    return list(dict.fromkeys(runs))


def _build(scene: str, matrix: Matrix, profile: Profile, data: Path, captures: Path | None) -> Path:
    rainy = any(find_method(method).trains_on != "clean" for method in matrix.methods)
    patterns: Sequence[str] = matrix.patterns if rainy else ()
    return build_source(scene, data, profile, patterns=tuple(patterns), all_patterns=rainy, captures=captures)


def _has_clean(method: str, folder: Path) -> bool:
    has = not is_captured(folder) or has_ceiling(folder)
    if not has:
        logger.info("%s: its training views have no clean photographs: no row of %s", folder.name, method)
    return has


def is_finished(run: Run) -> bool:
    """Whether a run is done with the settings and data of today."""
    return (run.folder / CONFIG).is_file() and has_settings(run) and kept_record(run) is not None
