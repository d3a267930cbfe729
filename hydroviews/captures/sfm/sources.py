"""The photographs that cameras are estimated for: links to them, and what becomes of work on others."""

import logging
import re
import shutil
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from hydroviews.captures.exif_orientation import write_upright
from hydroviews.captures.sfm import rain
from hydroviews.captures.sfm.mapping import MAPPING
from hydroviews.captures.sfm.room import DATABASE, LEARNED, PAIRS
from hydroviews.errors import InputError
from hydroviews.files import ownership
from hydroviews.files.atomic import read_json, replacing
from hydroviews.formats.photographs import some, view_names
from hydroviews.scene.images import read_pixels

logger = logging.getLogger(__name__)

PHOTOGRAPHS = ("images", "files")  # settings that say which photographs
FOLLOWING = "exhaustive"  # one that may follow from their number

_DATABASES = [DATABASE + suffix for suffix in ("", rain.DETECTED)]
WORKING_FILES = (  # of pycolmap, in the capture's folder
    *(name + side for name in _DATABASES for side in ("", "-journal", "-wal", "-shm")),
    *(DATABASE + rain.GUIDED, DATABASE + rain.COPIES + "/", LEARNED + "/", MAPPING + "/", PAIRS),
)


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
        if turned:
            write_upright(source, target)
            continue
        try:
            ownership.enter(target)
            target.unlink(missing_ok=True)  # a link to where the photographs were before they were moved
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
        InputError: they were; or the folder is of an earlier version, so that nothing tells whose files are there.
    """
    earlier = read_json(path) if path.is_file() else settings
    changed = {key for key in settings if not isinstance(earlier, dict) or earlier.get(key) != settings[key]}
    if not changed & set(PHOTOGRAPHS) or changed - {*PHOTOGRAPHS, FOLLOWING}:
        return
    if finished:
        raise _other_photographs(path.parent, earlier.get("images", []), settings["images"])
    if not ownership.is_claimed(path.parent):
        raise _other_photographs(path.parent, earlier.get("images", []), settings["images"])
    logger.info("%s: other photographs than before, so that their features are found anew", path.parent)
    left = [file for one in remove for file in ownership.remove(one)]
    if left:
        logger.warning("%s: not written by HydroViews, and kept: %s", path.parent, ownership.named(left, path.parent))
    path.unlink()


def refuse_foreign(settings: Path, targets: Iterable[Path]) -> None:
    """Refuse a capture's folder in which somebody else's files stand where an estimate writes.

    Args:
        settings: the JSON file that an earlier estimate left in the folder; it need not exist.
        targets: files and folders that are written; none need exist.

    Raises:
        InputError: there are such files.
    """
    folder = settings.parent
    if settings.is_file() and not ownership.is_claimed(folder):  # of an earlier version, which kept no list
        return
    pictures = folder / "images"  # in a folder of ours, single ones may lie beside the links
    stand = [one for one in targets if not (one == pictures and settings.is_file())]
    foreign = [file for one in stand if not ownership.is_ours(one) for file in _files(one)]
    if foreign:
        raise InputError(
            f"{folder}: holds files that are not of this estimate of cameras, and would be in the way",
            found=ownership.named(foreign, folder),
            expected="a folder without photographs, database and model of somebody else's",
            fix="choose another --out; nothing there was changed",
        )


def _files(path: Path) -> list[Path]:
    return ownership.left_by_others(path) if path.is_dir() and not path.is_symlink() else [path] * path.exists()


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
        fix="put the photographs back as they were; or remove this folder; or estimate cameras into another one: "
        "`hydroviews poses PHOTOGRAPHS --out FOLDER`",
    )
