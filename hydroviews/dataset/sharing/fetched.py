"""Scenes that were fetched and whose capture need not be here: they are used as they are, and not built."""

from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

from hydroviews.dataset.checks.repair import damaged_files, drop_or_refuse
from hydroviews.dataset.clean_views import CLEAN
from hydroviews.dataset.manifest import read_manifest
from hydroviews.dataset.variants import is_captured
from hydroviews.errors import InputError
from hydroviews.rain.patterns import Pattern

FETCHED = "fetched"  # a fact of the manifest: true where the whole scene came from archives


def find_fetched(
    source: str,
    data: Path,
    named: Collection[Pattern],
    usual: Collection[Pattern],
    long_side: int,
    seed: int | None,
    lens_renderer: str | None,
) -> Path | None:
    """The fetched scene that a build of these settings would give; None where it has to be built.

    Args:
        source: what the scene is called: its own name, or that of its capture.
        data: the data folder.
        named: patterns that are wanted.
        usual: those that are wanted where none is named; of a capture that was taken in rain, none.
        long_side: pixels.
        seed: None if any will do, as is the lens renderer.
        lens_renderer: another than the scene's is for the build to refuse.

    Raises:
        InputError: a file is no longer what the manifest says.
    """
    for name, entry in _fetched(source, data):
        if entry.get("long_side") != long_side or seed not in (None, entry.get("seed")) or lens_renderer is not None:
            continue
        wanted = {pattern.name for pattern in named or (() if is_captured(data / name) else usual)}
        if wanted <= set(entry["patterns"]):
            damaged = damaged_files(data / name, entry, wanted, described=False)
            drop_or_refuse(data / name, damaged, repair=False, repairable=False)
            return data / name
    return None


def unfit(source: str, data: Path) -> InputError | None:
    """The error if a fetched scene of that name does not fit and its capture is not here; None without such a scene."""
    for name, entry in _fetched(source, data):
        patterns = ", ".join((CLEAN, *entry["patterns"]))
        return InputError(
            f"{data / name}: the downloaded scene does not have what is wanted, and its capture is not here",
            found=f"{patterns}, {entry.get('long_side')} pixels, seed {entry.get('seed')}",
            fix="ask for what is there, or put the capture here to build the rest",
        )
    return None


def _fetched(source: str, data: Path) -> Iterator[tuple[str, dict[str, Any]]]:
    """Names and manifest entries of the fetched scenes that are called so, or whose capture is."""
    for name, entry in read_manifest(data)["scenes"].items():
        if entry.get(FETCHED) and source in (name, str(entry.get("source"))):
            yield name, entry
