"""Damage in a finished scene: files that no longer hold the bytes that the manifest lists.

A build never takes such a file for a good one. It refuses the scene, or, asked to repair it, removes what has changed
and makes it again from the capture; what is made again must have the bytes of before.
"""

import logging
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

from hydroviews.dataset.card.card import CARD, LICENCE
from hydroviews.dataset.drop_masks import BUILT as DROPS
from hydroviews.dataset.manifest import changed_files, listed_files, scene_entry
from hydroviews.dataset.request import REQUEST
from hydroviews.dataset.statistics import STATISTICS
from hydroviews.errors import InputError
from hydroviews.files import ownership
from hydroviews.files.known_bytes import current_sha256
from hydroviews.formats.capture_json import CAPTURED
from hydroviews.formats.photographs import some
from hydroviews.formats.writers import MODEL, MODEL_FILES

logger = logging.getLogger(__name__)

REMOVE = "restore them, or remove {folder} and build it again"
WRITTEN_ANEW = (CARD, STATISTICS, f"{LICENCE}/")  # by every build: what describes the scene as a whole


def require_request(folder: Path) -> None:
    """Refuse a scene whose request is no longer that of the manifest: nobody knows what it was asked to be.

    Raises:
        InputError: it has changed.
    """
    entry = scene_entry(folder)
    digest = entry["files"].get(REQUEST) if entry else None
    if digest and (folder / REQUEST).is_file() and current_sha256(folder / REQUEST) != digest:
        raise _damage(folder, [folder / REQUEST], REMOVE.format(folder=folder))


def damaged_files(folder: Path, entry: Mapping[str, Any], wanted: Collection[str], described: bool) -> list[Path]:
    """The files of a finished scene that have changed.

    Args:
        folder: of the scene.
        entry: what the manifest says of it.
        wanted: names of variants; where all are there, the others are not looked at, else all of them are.
        described: look at what every build writes anew as well.
    """
    others = set(entry["patterns"]) - set(wanted) if set(wanted) <= set(entry["patterns"]) else set()
    skipped = (*(f"{name}/" for name in others), *(() if described else WRITTEN_ANEW))
    return changed_files(_listed(folder, entry, skipped), folder.name)


def drop_or_refuse(folder: Path, damaged: Sequence[Path], repair: bool, repairable: bool) -> None:
    """Remove changed files, which are then made again, or refuse the scene.

    Args:
        folder: of the scene.
        damaged: the files.
        repair: whether they may be made again.
        repairable: whether today's code would make the same files.

    Raises:
        InputError: there are any, and they are not to be repaired, or cannot be.
    """
    if not damaged:
        return
    if not (repair and repairable):
        mend = "add --repair to have them made again from the capture"
        raise _damage(folder, damaged, mend if repairable else REMOVE.format(folder=folder))
    logger.warning("%s: %d changed files are made again", folder, len(damaged))
    for path in damaged:
        path.unlink()
    if any(folder / MODEL in path.parents for path in damaged):
        ownership.clear(folder / MODEL, [folder / MODEL / name for name in MODEL_FILES])  # it is written as a whole


def unchanged(folder: Path, entry: Mapping[str, Any], redrawn: Collection[str]) -> dict[str, str]:
    """SHA-256 by name of the listed files that a build leaves as they were, compared once more.

    Args:
        folder: of the scene, built.
        entry: what the manifest said of it before.
        redrawn: variants that were drawn anew, with other bytes.

    Raises:
        InputError: a file is missing, or has other bytes than before.
    """
    listed = _listed(folder, entry, (*WRITTEN_ANEW, *(f"{name}/" for name in redrawn)))
    late = folder / CAPTURED / DROPS  # they are written when the scene is finished, and compared then
    missing = [path for path in listed if path.parent != late and not path.is_file()]
    other = missing or changed_files(listed, folder.name)
    if other:
        raise _damage(folder, other, REMOVE.format(folder=folder))
    return {path.relative_to(folder).as_posix(): digest for path, digest in listed.items()}


def _listed(folder: Path, entry: Mapping[str, Any], skipped: tuple[str, ...]) -> dict[Path, str]:
    files = {name: digest for name, digest in entry["files"].items() if not name.startswith(skipped)}
    return listed_files(folder, {"files": files})


def _damage(folder: Path, files: Sequence[Path], fix: str) -> InputError:
    return InputError(
        f"{folder}: not what the manifest says",
        found=f"{some([path.relative_to(folder).as_posix() for path in files])}: changed or missing",
        expected="the bytes that were built",
        fix=fix,
    )
