"""The photographs that cameras are estimated for: links to them, and what becomes of work on others."""

import logging
import re
import shutil
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from hydroviews.captures.exif_orientation import write_upright
from hydroviews.errors import InputError
from hydroviews.files.atomic import read_json, replacing
from hydroviews.files.temporary import remove_tree
from hydroviews.formats.photographs import some, view_names
from hydroviews.scene.images import read_pixels

logger = logging.getLogger(__name__)

PHOTOGRAPHS = ("images", "files")  # settings that say which photographs
FOLLOWING = "exhaustive"  # one that may follow from their number


def link_names(images: Path, sources: list[Path]) -> dict[str, Path]:
    """Flat file names without blanks, unique without their suffixes, and the photographs they stand for.

    Raises:
        InputError: two photographs would have one name.
    """
    relative = [path.relative_to(images).as_posix() for path in sources]
    stems = [without_blanks(stem) for stem in view_names(relative)]
    if len(set(stems)) < len(stems):
        twice = sorted({stem for stem in stems if stems.count(stem) > 1})
        raise InputError(f"{images}: several images share a name", found=some(twice), fix="rename them")
    return {stem + path.suffix: path for stem, path in zip(stems, sources, strict=True)}


def without_blanks(name: str) -> str:
    """A name for COLMAP's text forms, which split lines at white space of any kind."""
    return re.sub(r"\s", "_", name)


def link_photographs(links: Mapping[str, Path], folder: Path, turned: bool) -> None:
    """Put links to the photographs into a folder, or copies turned upright; those that are there stay.

    Raises:
        InputError: a photograph cannot be read; the error names it, and not its link.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for name, source in links.items():
        target = folder / name
        if target.exists():
            continue
        read_pixels(source)
        target.unlink(missing_ok=True)  # a link to where the photographs were before they were moved
        if turned:
            write_upright(source, target)
            continue
        try:
            target.symlink_to(source.resolve())
        except OSError:  # no links on this file system
            with replacing(target) as temporary:
                shutil.copy2(source, temporary)


def forget_other_photographs(path: Path, settings: Mapping[str, Any], remove: Iterable[Path], finished: bool) -> None:
    """Where other photographs have the same settings, remove the unfinished work on them, so that these are begun.

    So a photograph can be mended, or more be added, until cameras are found.

    Args:
        path: the JSON file with the settings of the work that is there.
        settings: those wanted now.
        remove: files and folders of unfinished work; none need exist.
        finished: whether cameras were found.

    Raises:
        InputError: they were.
    """
    earlier = read_json(path) if path.is_file() else settings
    changed = {key for key in settings if not isinstance(earlier, dict) or earlier.get(key) != settings[key]}
    if not changed & set(PHOTOGRAPHS) or changed - {*PHOTOGRAPHS, FOLLOWING}:
        return
    if finished:
        raise _other_photographs(path.parent, earlier.get("images", []), settings["images"])
    logger.info("%s: other photographs than before, so that their features are found anew", path.parent)
    for one in remove:
        if one.is_dir() and not one.is_symlink():
            remove_tree(one)
        else:
            one.unlink(missing_ok=True)
    path.unlink()


def _other_photographs(folder: Path, earlier: list[str], now: list[str]) -> InputError:
    added, gone = sorted(set(now) - set(earlier)), sorted(set(earlier) - set(now))
    differences = [
        f"{some(names)} {what}"
        for names, what in (
            (added, "added"),
            (gone, "gone"),
        )
        if names
    ]
    return InputError(
        f"{folder}: has the cameras of other photographs",
        found="; ".join(differences) or "photographs of the same names and other sizes",
        fix="put the photographs back as they were, or choose another --out for these",
    )
