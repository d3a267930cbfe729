"""Which files are ours: the one place that decides what a command may overwrite or remove.

A folder that a command has claimed holds the hidden list FOLDER, with a line for every file that was written below it.
All other outputs, such as single pictures, are listed in FILES beside them. A file that stands in no list is somebody
else's: nothing removes such a file, and a result of the same name sets it aside. Names alone are compared, so that
lists outlive copies and moves of their folders.
"""

import filecmp
import json
import logging
import os
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import lru_cache, partial
from itertools import count
from pathlib import Path, PurePosixPath

from hydroviews.errors import InputError
from hydroviews.files.locks import LOCK
from hydroviews.files.temporary import PARTIAL, UNFINISHED

logger = logging.getLogger(__name__)

FOLDER, FILES = ".hydroviews-folder", ".hydroviews-files"
LISTS = (FOLDER, FILES)
SHOWN = 5  # names in a message


def claim(folder: Path) -> None:
    """Begin the list of a folder in which nobody else has files; whatever is written below is entered from now on."""
    folder.mkdir(parents=True, exist_ok=True)
    if not (folder / FOLDER).is_file():
        (folder / FOLDER).touch()


def claim_new(folder: Path) -> None:
    """Begin the list of a folder of our own, unless the folder has a list.

    Raises:
        InputError: there are files in the folder and no list.
    """
    if is_claimed(folder):
        return
    if others := left_by_others(folder):
        raise InputError(
            f"{folder}: holds other files",
            found=named(others, folder),
            expected="a new or empty folder, or one with the list of what HydroViews wrote",
            fix="choose another --out, or move the files to another place",
        )
    claim(folder)


def is_claimed(folder: Path) -> bool:
    """Whether the folder or one above has a list of what was written below it."""
    folder = Path(os.path.abspath(folder))
    return any((one / FOLDER).is_file() for one in (folder, *folder.parents))


def enter_all(names: Iterable[str], folder: Path) -> None:
    """Enter what other programs will write in a folder of ours, by names; one that ends in "/" is a whole folder.

    Raises:
        InputError: something of somebody else's has such a name.
    """
    own = _list_of(folder / FOLDER)
    if own is None:
        return
    known, names = _entries(own), list(names)
    foreign = [folder / name for name in names if os.path.lexists(folder / name) and not is_ours(folder / name)]
    if foreign:
        raise foreign_files(foreign)
    slashes = [_within(own, folder / name) + "/" * name.endswith("/") for name in names]
    _append(own, [name for name in slashes if name not in known])


def enter(path: Path, written: Path | None = None) -> None:
    """Enter a file or folder in its list, just before it is put under its name; a file of somebody else's is set aside.

    Args:
        path: where it goes; where no list is in reach, FILES is begun beside it.
        written: where it is so far; a folder's files are entered one by one.
    """
    own = _list_of(path) or _begun_beside(path)
    if own is None:
        return
    if os.path.lexists(path) and not _is_folder(written or path):
        if _has_content_of(path, written) or (is_ours(path) and not _is_folder(path)):
            return
        set_aside(path)
    written = Path(os.path.abspath(written or path))
    inside = [path / file.relative_to(written) for file in _files_below(written)] if _is_folder(written) else [path]
    _append(own, [_within(own, one) for one in inside])


def _begun_beside(path: Path) -> Path | None:
    """FILES beside a file; none in a folder of ours that has no name yet, or where nothing may be written."""
    if any(part.startswith((PARTIAL, UNFINISHED)) for part in Path(os.path.abspath(path)).parts[:-1]):
        return None
    try:
        (path.parent / FILES).touch()
    except OSError:  # writing the file itself raises what the user can mend
        return None
    return path.parent / FILES


def _has_content_of(path: Path, written: Path | None) -> bool:
    """True for a file, not a link, with the bytes of the file that is to replace it."""
    if written is None or path.is_symlink() or not (path.is_file() and written.is_file()):
        return False
    return filecmp.cmp(path, written, shallow=False)


def set_aside(path: Path) -> Path:
    """Give a file or folder of somebody else's another name, which is returned.

    To refuse what is in the way would end what may have taken hours.
    """
    names = (path.with_name(f"{path.name}.kept{number or ''}") for number in count())
    free = next(name for name in names if not os.path.lexists(name))
    os.replace(path, free)
    logger.warning("%s: not written by HydroViews, and in the way: it is now called %s", path, free.name)
    return free


def _append(own: Path, names: Iterable[str]) -> None:
    with suppress(PermissionError), own.open("a") as lines:  # in a folder of another user's nothing can be entered
        lines.writelines(f"{json.dumps(name)}\n" for name in names)


@contextmanager
def adopting(folder: Path) -> Iterator[None]:
    """Enter what a method or program that keeps no list writes into a folder of ours while the block lasts."""
    before = set(_not_ours(folder, ()))
    try:
        yield
    finally:
        adopt([path for path in _not_ours(folder, ()) if path not in before], folder)


def adopt(files: Iterable[Path], folder: Path) -> None:
    """Enter files that are there and known to be ours in the list of their folder, if the folder has one."""
    own = _list_of(folder / FOLDER)
    if own is not None:
        _append(own, [_within(own, path) for path in files])


def is_ours(path: Path) -> bool:
    """Whether a list has the file; of a folder, whether lists have all files below it."""
    if _is_folder(path):
        return not left_by_others(path)
    return _is_at_work(path) or any(_has(_entries(one), _within(one, path)) for one in _above(path))


def _is_at_work(path: Path) -> bool:
    return path.name.startswith((*LISTS, LOCK, PARTIAL))


def _has(entries: Collection[str], name: str) -> bool:
    """Whether a list has a name, or a whole folder that it is below."""
    return name in entries or any(f"{parent}/" in entries for parent in PurePosixPath(name).parents)


def left_by_others(folder: Path, known: Collection[Path] = ()) -> list[Path]:
    """Files below a folder, sorted, that stand in no list, nor among those known to be ours; it need not exist.

    Hidden ones are not among them: file managers leave such things everywhere.
    """
    return _visible(_not_ours(folder, known), folder)


def _not_ours(folder: Path, known: Collection[Path]) -> list[Path]:
    """`left_by_others` with hidden files."""
    files = list(_files_below(folder))
    own = {Path(os.path.abspath(path)) for path in known}
    others = [path for path in files if path not in own and not _is_at_work(path)]
    for one in {*_above(folder / FOLDER), *(path for path in files if path.name in LISTS)}:
        entries = _entries(one)
        others = [path for path in others if not _has(entries, _within(one, path))]
    return sorted(others)


def remove(path: Path, known: Collection[Path] = ()) -> list[Path]:
    """Remove a file or folder as far as it is ours, and folders that are empty then.

    Args:
        path: need not exist.
        known: further files that are ours.

    Returns:
        What is left: the files of somebody else's, hidden ones not among them.
    """
    if not _is_folder(path):
        if is_ours(path) or path in known:
            path.unlink(missing_ok=True)
        return [path] if os.path.lexists(path) else []
    path = Path(os.path.abspath(path))
    kept = set(_not_ours(path, known))
    files = [file for file in _files_below(path) if file not in kept]
    # Settings of the folder and lists go last: an interruption leaves a folder that is known.
    for file in sorted(files, key=lambda file: (file.parent == path, file.name in LISTS)):
        if file != path / FOLDER or not kept:
            file.unlink(missing_ok=True)
    for here, _, _ in os.walk(path, topdown=False):
        with suppress(OSError):  # not empty
            os.rmdir(here)
    return _visible(sorted(kept), path)


def clear(path: Path, known: Collection[Path] = ()) -> None:
    """Remove a file or folder that is to be made anew, unless something of somebody else's is in it.

    Raises:
        InputError: there is such a thing, or no list tells; nothing was removed.
    """
    left = left_by_others(path, known) if _is_folder(path) else [path] * (os.path.lexists(path) and not is_ours(path))
    if left and not is_claimed(path.parent):
        raise unlisted(path.parent)
    if left:
        raise foreign_files(left)
    remove(path, known)


def require_ours(paths: Iterable[Path]) -> None:
    """Refuse files and folders of somebody else's that have the names of outputs, before anything is calculated.

    Raises:
        InputError: something of somebody else's has such a name.
    """
    foreign = [path for path in paths if os.path.lexists(path) and not is_ours(path)]
    if foreign:
        raise foreign_files(foreign)


def foreign_files(paths: Collection[Path]) -> InputError:
    """The error for files of somebody else's in the way of our own."""
    first = min(paths)
    return InputError(
        f"{first}: not written by HydroViews, and in the way",
        found=named(paths, first.parent),
        expected="a name that is free",
        fix="move it to another place, or choose another --out",
    )


def unlisted(folder: Path) -> InputError:
    """The error for a folder of ours in which nothing tells whose the files are."""
    return InputError(
        f"{folder}: nothing tells which of its files are yours",
        found="a folder of an earlier version, without a list of the files that were written",
        expected=FOLDER,
        fix="move out what is yours, and remove the folder",
    )


def named(paths: Iterable[Path], folder: Path) -> str:
    """The first few names below a folder, and how many more there are."""
    names = [_relative(path, folder) for path in sorted(paths)]
    more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
    return ", ".join(names[:SHOWN]) + more


def _visible(files: Iterable[Path], folder: Path) -> list[Path]:
    return [path for path in files if not any(part.startswith(".") for part in Path(_relative(path, folder)).parts)]


def _list_of(path: Path) -> Path | None:
    """The list in which a file is entered: FILES beside it, else FOLDER beside or above."""
    return next(_above(path), None)


def _above(path: Path) -> Iterator[Path]:
    """All lists that may have a file."""
    path = Path(os.path.abspath(path))
    candidates = (path.parent / FILES, *(folder / FOLDER for folder in path.parents))
    return (one for one in candidates if one.is_file())


def _within(own: Path, path: Path) -> str:
    return _relative(path, own.parent)


def _relative(path: Path, folder: Path) -> str:
    return os.path.relpath(os.path.abspath(path), os.path.abspath(folder))


def _entries(own: Path) -> frozenset[str]:
    """The names in a list."""
    try:
        state = own.stat()
    except FileNotFoundError:
        return frozenset()
    return _read_entries(own, state.st_mtime_ns, state.st_size)


@lru_cache(maxsize=16)
def _read_entries(own: Path, _changed: int, _size: int) -> frozenset[str]:
    """The names in a list as it is by now; what an interruption cut short counts as none."""
    names = set()
    for line in own.read_text(errors="replace").splitlines():
        with suppress(ValueError):
            names.add(str(json.loads(line)))
    return frozenset(names)


def _is_folder(path: Path) -> bool:
    return path.is_dir() and not path.is_symlink()


def _files_below(folder: Path) -> Iterator[Path]:
    """Files and links below a folder, by absolute paths."""
    join = partial(Path, os.path.abspath(folder))
    for here, folders, files in os.walk(folder):
        links = [name for name in folders if Path(here, name).is_symlink()]
        yield from (join(os.path.relpath(here, folder), name) for name in (*files, *links))
