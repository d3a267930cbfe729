"""Files that a run writes into its folder beside its method, and leftovers of a method in their way."""

from collections.abc import Sequence
from pathlib import Path

from hydroviews.files import ownership
from hydroviews.formats.photographs import some
from leaderboard.records import PER_VIEW, RECORD
from leaderboard.runs.sessions import CONFIG, SESSIONS

PREDICTION = "prediction.json"  # time, memory, size
RENDERS = "renders"  # pictures of the held-out views
HIDDEN = "hidden"  # pictures of what the method takes for something before the scene
PREVIEW = "preview.png"
FILES, FOLDERS = (CONFIG, SESSIONS, PREDICTION, RECORD, PER_VIEW, PREVIEW), (RENDERS, HIDDEN)


def in_the_way(folder: Path) -> list[Path]:
    """What lies in a run's folder where the run writes, and cannot be replaced: folders for files, files for folders.

    A link in place of a folder counts, as it leads elsewhere; and so does a file in place of the run's folder itself.
    """
    if _is_other(folder) and not folder.is_dir():
        return [folder]
    files = [folder / name for name in FILES if (folder / name).is_dir()]
    folders = [path for name in FOLDERS if _is_other(path := folder / name)]
    pictures = [path for name in FOLDERS for path in (folder / name).glob("*.png") if path.is_dir()]
    return files + folders + pictures


def clear_the_way(folder: Path) -> list[Path]:
    """Give what is in the way of a run that has this folder other names; returns what it was called."""
    found = in_the_way(folder)
    for path in found:
        ownership.set_aside(path)
    return found


def left_by_the_method(paths: Sequence[Path]) -> str:
    """Why a run has failed whose method has left something in the way."""
    return f"the method left something of its own where its run writes: {some([path.name for path in paths])}"


def _is_other(path: Path) -> bool:
    """Whether there is something else than a folder."""
    return path.is_symlink() or (path.exists() and not path.is_dir())
