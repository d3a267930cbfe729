"""Small pictures that ship with a board: three renders of a run, and the views that the run was given.

A run of a board has `renders/VIEW.webp`. The same views, clean and in rain, lie once in the board's folder of views, as
`views/PROFILE/SCENE/PATTERN/VIEW.webp`. Only runs on scenes that this project draws have pictures on a board: captures
have the licences of their makers.
"""

import logging
from collections.abc import Iterator, Mapping
from pathlib import Path

from hydroviews.blender.embedded_scenes.captures import EMBEDDED
from hydroviews.dataset.clean_views import CLEAN
from hydroviews.errors import InputError
from hydroviews.files.atomic import write_bytes
from leaderboard.records import Record
from leaderboard.runs.own_files import RENDERS
from leaderboard.site.pictures import IMAGES, SMALL, VIEWS_FOLDER, built_scene, chosen_renders, small_copy, view_paths

logger = logging.getLogger(__name__)


def small_renders(folder: Path, scene: str) -> dict[str, bytes]:
    """Small renders of a run by their names below its folder; those that a board has are taken as they are.

    Raises:
        OSError: a damaged picture.
    """
    if scene not in EMBEDDED:
        return {}
    paths = chosen_renders(folder)
    return {f"{RENDERS}/{path.stem}{SMALL}": small_copy(path) for path in paths}


def ship_views(runs: Mapping[Path, Record], results: Path, data: Path | None, board: Path) -> None:
    """Write the views that runs of a board were given, of those that have renders there, unless they are there.

    Args:
        runs: by their folders below the board.
        results: folder that the runs were taken from; if it is a board, its views are taken.
        data: folder of the data sets otherwise. Views of data that are missing or have changed are left out, which is
            logged.
        board: takes the views.
    """
    for source, name in _copied(results):
        _write(board / VIEWS_FOLDER / name, source)
    missing: dict[str, None] = {}
    for run, record in runs.items():
        views = [path.stem for path in sorted((board / run / RENDERS).glob(f"*{SMALL}"))]
        for pattern in dict.fromkeys((CLEAN, record.pattern)):
            target = Path(record.profile, record.scene, pattern)
            lacking = [view for view in views if not (board / VIEWS_FOLDER / target / f"{view}{SMALL}").is_file()]
            if lacking and data is not None:
                try:
                    scene = built_scene(data, record.profile, record.scene, record.pattern, record.data_sha256)
                except InputError as error:
                    missing[str(error)] = None
                    continue
                images = scene / CLEAN if pattern == CLEAN else scene / pattern / IMAGES
                for view, path in view_paths(scene, images, lacking).items():
                    _write(board / VIEWS_FOLDER / target / f"{view}{SMALL}", path)
    for reason in missing:
        logger.warning("views without pictures on the board: %s", reason)


def _copied(results: Path) -> Iterator[tuple[Path, Path]]:
    folder = results / VIEWS_FOLDER
    return ((path, path.relative_to(folder)) for path in sorted(folder.rglob(f"*{SMALL}")))


def _write(path: Path, source: Path) -> None:
    if not path.is_file():
        write_bytes(path, small_copy(source))
