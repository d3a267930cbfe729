"""Small pictures that ship with a board: three renders of a run, and the views that the run was given.

A run of a board has `renders/VIEW.webp`. The same views, clean and in rain, lie once in the board's folder of views, as
`views/PROFILE/SCENE/PATTERN/VIEW.webp`. Only runs on scenes that this project draws have pictures on a board: captures
have the licences of their makers.
"""

import logging
from collections.abc import Mapping
from pathlib import Path

from hydroviews.blender.embedded_scenes.captures import EMBEDDED
from hydroviews.dataset.clean_views import CLEAN
from hydroviews.errors import InputError
from hydroviews.files.atomic import write_bytes
from leaderboard.records import Record
from leaderboard.runs.own_files import RENDERS
from leaderboard.site.pictures import (
    SMALL,
    VIEWS_FOLDER,
    built_scene,
    chosen_renders,
    images_of,
    small_copy,
    view_paths,
)

logger = logging.getLogger(__name__)


def shipped_renders(folder: Path, scene: str) -> dict[str, Path]:
    """The renders of a run that go onto a board as small copies, by their names there; none of a capture."""
    paths = chosen_renders(folder) if scene in EMBEDDED else []
    return {f"{RENDERS}/{path.stem}{SMALL}": path for path in paths}


def ship_views(runs: Mapping[Path, Record], results: Path, data: Path | None, board: Path) -> None:
    """Write the views that runs of a board were given, of those that have renders there, in place of other data's.

    Args:
        runs: by their folders below the board.
        results: folder that the runs were taken from; if it is a board, its views are taken.
        data: folder of the data sets otherwise. Views of data that are missing or have changed are left out, which is
            logged.
        board: takes the views.
    """
    for source in sorted((results / VIEWS_FOLDER).rglob(f"*{SMALL}")):
        _write(board / source.relative_to(results), source)
    if data is None:
        return
    wanted: dict[tuple[str, ...], set[str]] = {}  # views, of all runs that were given them together
    for run, record in runs.items():
        given = record.profile, record.scene, record.pattern, record.data_sha256
        wanted.setdefault(given, set()).update(path.stem for path in (board / run / RENDERS).glob(f"*{SMALL}"))
    missing: dict[str, None] = {}
    for (profile, scene, rain, digest), views in wanted.items():
        for pattern in dict.fromkeys((CLEAN, rain)) if views else ():
            target = board / VIEWS_FOLDER / profile / scene / pattern
            try:
                built = built_scene(data, profile, scene, rain, digest)
            except InputError as error:
                if not all((target / f"{view}{SMALL}").is_file() for view in views):
                    missing[str(error)] = None
                continue
            for view, path in view_paths(built, images_of(built, pattern), sorted(views)).items():
                _write(target / f"{view}{SMALL}", path)
    for reason in missing:
        logger.warning("views without pictures on the board: %s", reason)


def _write(path: Path, source: Path) -> None:
    content = small_copy(source)
    if not path.is_file() or path.read_bytes() != content:  # of other data, which the runs had earlier
        write_bytes(path, content)
