"""A folder holds the results of one set of settings: a call with other settings is refused.

Builds, runs and pose estimates keep their settings in a JSON file of their folder. A later call resumes what is there
only if its settings are the same.
"""

import logging
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from hydroviews.errors import InputError
from hydroviews.files import ownership
from hydroviews.files.atomic import is_there, read_json, write_json
from hydroviews.files.temporary import remove_leftovers

logger = logging.getLogger(__name__)


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
    """Record these settings in a folder, or check that they are the ones recorded there.

    What killed processes left half written in the folder is removed.

    Args:
        path: the JSON file with the folder's settings.
        settings: JSON values by name.
        taken: the error's text for a folder with other settings.
        foreign: the error's text for a folder with files and no settings; None where one that is ours gets more
            settings, such as a capture that gets masks.
        fix: what the user should do about other settings.
        ignored: names of settings that may differ: they inform, and change no result.
        overwrite: remove what was made with other settings instead of refusing it; files of somebody else's stay, and
            a warning names them.
        forget: called before anything is removed.

    Raises:
        InputError: the folder has other settings, or holds files of unknown origin; or it was made before files were
            listed, so that nothing tells whose they are.
    """
    folder = path.parent
    remove_leftovers(folder)
    if not is_there(path):
        _refuse_foreign(folder, foreign, path.name)
        if not ownership.is_claimed(folder):
            ownership.claim(folder)
        write_json(path, dict(settings))
        return
    earlier = _earlier(path, fix, overwrite)
    changed = _changed(earlier, settings, ignored)
    if not changed:
        return
    if not overwrite:
        raise InputError(
            f"{folder}: {taken}",
            found="; ".join(f"{key} {_difference(earlier.get(key), settings[key])}" for key in changed),
            expected="; ".join(f"{key} {_difference(settings[key], earlier.get(key))}" for key in changed),
            fix=fix,
        )
    left = ownership.left_by_others(folder, [path])
    if left and not ownership.is_claimed(folder):
        raise ownership.unlisted(folder)
    forget()
    ownership.remove(folder, [path])
    if left:
        logger.warning("%s: not written by HydroViews, and kept: %s", folder, ownership.named(left, folder))
    ownership.claim(folder)
    write_json(path, dict(settings))


def has_settings(path: Path, settings: Mapping[str, Any]) -> bool:
    """Whether a folder's JSON file records these settings.

    Raises:
        InputError: it is damaged, or there is none.
    """
    earlier = read_json(path)
    return isinstance(earlier, dict) and not _changed(earlier, settings)


def _changed(earlier: Mapping[str, Any], settings: Mapping[str, Any], ignored: Sequence[str] = ()) -> list[str]:
    return [key for key in settings if key not in ignored and earlier.get(key) != settings[key]]


def _earlier(path: Path, fix: str, overwrite: bool) -> dict[str, Any]:
    """The settings recorded; none where the file cannot be read and will be overwritten."""
    try:
        earlier = read_json(path, fix)
    except InputError:
        if not overwrite:
            raise
        earlier = {}
    return earlier if isinstance(earlier, dict) else {}


def _refuse_foreign(folder: Path, foreign: str | None, name: str) -> None:
    visible = [p.name for p in folder.iterdir() if not p.name.startswith(".")] if folder.is_dir() else []
    if visible and foreign is not None:
        raise InputError(
            f"{folder}: {foreign}",
            found=f"{len(visible)} files and no {name}",
            fix="choose another folder, or an empty one",
        )


def _difference(value: Any, other: Any) -> Any:
    """The part of a setting that differs from another: changed items of a dict, the first new item of a list."""
    if isinstance(value, dict) and isinstance(other, dict):
        return {key: item for key, item in value.items() if other.get(key) != item}
    if isinstance(value, list) and isinstance(other, list):
        only = [item for item in value if item not in other]
        return f"{len(value)} entries" + (f", only here {only[0]}" if only else "")
    return value
