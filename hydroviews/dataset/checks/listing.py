"""Whether a data folder holds what its manifest lists, and nothing else; nothing outside of it is read."""

import os
from collections.abc import Iterator, Mapping
from pathlib import Path, PurePosixPath
from typing import Any

from hydroviews.dataset.card.contact_sheet import SHEETS
from hydroviews.dataset.manifest import MANIFEST, changed_files, listed_files, steps_below
from hydroviews.dataset.rainy_variant import LENS, SHARED
from hydroviews.dataset.request import REQUEST
from hydroviews.dataset.sharing.croissant import CROISSANT
from hydroviews.dataset.sources import RENDERED
from hydroviews.files.atomic import not_a_file
from hydroviews.files.locks import LOCK
from hydroviews.files.ownership import LISTS
from hydroviews.files.temporary import PARTIAL
from hydroviews.formats.capture_json import CAPTURED

_COPIED = [(name,) for name in SHARED]  # of a variant, where links cannot be made
Entry = Mapping[str, Any]  # what a manifest says of a scene


def check_folder(data: Path, scenes: Mapping[str, Entry]) -> list[str]:
    """What lies in a data folder beside the scenes of its manifest: unfinished scenes, and what nobody built."""
    problems = []
    for item in sorted(data.iterdir()):
        if item.name in (MANIFEST, SHEETS, RENDERED, CROISSANT) or _is_at_work(item) or item.name in scenes:
            problems += [_link(item)] if item.is_symlink() else []
        elif (item / REQUEST).is_file():
            problems.append(f"{item}: not finished; run its build again, or remove that folder")
        else:
            problems.append(_stray(item))
    return problems


def check_files(folder: Path, entry: Entry) -> list[str]:
    """Files of a scene that are missing, changed, links, or not listed, and variants that are not."""
    listed = {
        path: digest
        for path, digest in listed_files(folder, entry).items()
        if not any(step.is_symlink() for step in steps_below(folder, path))
    }
    changed = changed_files(listed, folder.name)
    problems = [_absent(path) for path in listed if not path.is_file()]
    problems += [f"{path}: changed since it was built" for path in changed]
    problems += [problem for _, problem in _unlisted(folder, entry)]
    drawn = {PurePosixPath(name).parts[0] for name in entry["files"] if PurePosixPath(name).match("*/pattern.json")}
    unlisted = sorted(drawn - {*entry["patterns"], CAPTURED})
    return problems + [f"{folder / name}: a variant that the manifest does not list" for name in unlisted]


def has_links(folder: Path, entry: Entry) -> bool:
    """Whether something in a scene may lead out of it."""
    return folder.is_symlink() or any(problem == _link(path) for path, problem in _unlisted(folder, entry))


def _unlisted(folder: Path, entry: Entry) -> Iterator[tuple[Path, str]]:
    """What lies in a scene's folder and is not in the manifest, nor at work, each with what is wrong with it."""
    names = entry["files"].keys()
    folders = {parent.as_posix() for name in names for parent in PurePosixPath(name).parents}
    for here, below, files in os.walk(folder):
        for name in sorted(below + files):
            path = Path(here, name)
            relative = path.relative_to(folder)
            part = relative.parts[1:2] if relative.parts[0] in (*entry["patterns"], CAPTURED) else ()  # of a variant
            known = relative.as_posix() in (folders if name in below else names) or part in _COPIED
            if path.is_symlink():
                if not (part in _COPIED and (len(relative.parts), os.readlink(path)) == (2, os.path.join("..", name))):
                    yield path, _link(path)
            elif not known and not (_is_at_work(path) or part == (LENS,)):
                yield path, _stray(path)
            if name in below and not known:
                below.remove(name)


def _absent(path: Path) -> str:
    return str(not_a_file(path)).replace("\n ", ",") if path.exists() else f"{path}: missing"


def _is_at_work(path: Path) -> bool:
    """Locks, lists of what was written, and what is being written or was left half written."""
    return path.name.startswith((LOCK, PARTIAL, *LISTS))


def _link(path: Path) -> str:
    return f"{path}: a link, which may lead out of the data set"


def _stray(path: Path) -> str:
    return f"{path}: not in the manifest"
