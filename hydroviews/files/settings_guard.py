"""A folder belongs to one set of settings: another is refused, not mixed in.

Builds, runs and pose estimates all keep what they were asked for in a JSON file of their folder, and go on with what
they find there only if they are asked for the same.
"""

import glob
import os
import re
import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from hydroviews.errors import InputError
from hydroviews.files.atomic import PARTIAL, read_json, remove_tree, write_json

OWNED = re.compile(re.escape(PARTIAL) + r"(\d+)-.+")  # names that `files.replacing` gives: with its process's number


def claim_folder(
    path: Path,
    settings: Mapping[str, Any],
    *,
    taken: str,
    foreign: str | None,
    fix: str,
    ignored: Sequence[str] = (),
    overwrite: bool = False,
    forget: Callable[[], None] = lambda: None,
) -> None:
    """Take the folder of `path` for these settings; what killed processes left half written there is removed.

    Args:
        path: the JSON file that keeps the folder's settings.
        settings: JSON values.
        taken: what to say of a folder with other settings.
        foreign: what to say of one that holds files and no settings; None takes it.
        fix: what to do about other settings.
        ignored: settings that may differ, for people to read.
        overwrite: empty a folder with other settings instead of refusing it.
        forget: called before the folder is emptied.

    Raises:
        InputError: the folder has other settings, or holds files of unknown origin.
    """
    folder = path.parent
    remove_leftovers(folder)
    if not path.is_file():
        _refuse_foreign(folder, foreign, path.name)
        write_json(path, dict(settings))
        return
    earlier = read_json(path)
    earlier = earlier if isinstance(earlier, dict) else {}
    changed = [key for key in settings if key not in ignored and earlier.get(key) != settings[key]]
    if not changed:
        return
    if not overwrite:
        raise InputError(
            f"{folder}: {taken}",
            found="; ".join(f"{key} {_difference(earlier.get(key), settings[key])}" for key in changed),
            expected="; ".join(f"{key} {_difference(settings[key], earlier.get(key))}" for key in changed),
            fix=fix,
        )
    forget()
    remove_tree(folder)
    write_json(path, dict(settings))


def remove_leftovers(path: Path) -> None:
    """Remove what processes that are no more left half written of a file or folder, or anywhere in the folder."""
    beside = path.parent.glob(f"{PARTIAL}*-{glob.escape(path.name)}") if path.parent.is_dir() else ()
    inside = path.rglob(f"{PARTIAL}*") if path.is_dir() else ()
    for leftover in [*beside, *inside]:
        owner = OWNED.fullmatch(leftover.name)
        if owner is None or _runs(int(owner[1])):
            continue
        if leftover.is_dir() and not leftover.is_symlink():
            shutil.rmtree(leftover, ignore_errors=True)
        else:
            leftover.unlink(missing_ok=True)


def _runs(process: int) -> bool:
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:  # somebody else's
        return True
    return True


def _refuse_foreign(folder: Path, foreign: str | None, name: str) -> None:
    visible = [p.name for p in folder.iterdir() if not p.name.startswith(".")] if folder.is_dir() else []
    if visible and foreign is not None:
        raise InputError(
            f"{folder}: {foreign}",
            found=f"{len(visible)} files and no {name}",
            fix="choose another folder, or remove that one",
        )


def _difference(value: Any, other: Any) -> Any:
    """Of two nested settings only what differs; of two lists how they begin to."""
    if isinstance(value, dict) and isinstance(other, dict):
        return {key: item for key, item in value.items() if other.get(key) != item}
    if isinstance(value, list) and isinstance(other, list):
        only = [item for item in value if item not in other]
        return f"{len(value)} entries" + (f", only here {only[0]}" if only else "")
    return value
