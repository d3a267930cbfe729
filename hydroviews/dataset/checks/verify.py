"""Checks that a built data set is what its manifest says, and that its rain is what seed and equations give."""

import logging
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hydroviews.dataset.checks.cameras import check_cameras
from hydroviews.dataset.checks.drawing import check_drawing
from hydroviews.dataset.checks.listing import check_files, check_folder, has_links
from hydroviews.dataset.checks.rain import check_rain
from hydroviews.dataset.manifest import MANIFEST, read_manifest, scene_entry
from hydroviews.dataset.request import drawn_otherwise
from hydroviews.errors import InputError

logger = logging.getLogger(__name__)


def verify(data: Path, every_view: bool = False) -> list[str]:
    """Compare every file with the manifest; derive cameras, rain, rainy views and their statistics again.

    Layers are drawn again from their seed, and rainy views and statistics derived from clean views, layers and
    parameters. `transforms.json` is compared with `sparse/0`, the split with the views. Nothing outside of the data
    folder is read: a link is a problem. A scene that was captured in rain has no rain to derive.

    Args:
        data: a data folder with a manifest, or a finished scene in one.
        every_view: derive all views of each variant again, not the first alone.

    Returns:
        One sentence a problem; empty where all is well.

    Raises:
        InputError: there is no manifest, or it is none.
    """
    one = None if os.path.lexists(data / MANIFEST) else scene_entry(data.resolve())
    manifest = (data.resolve().parent if one else data) / MANIFEST
    if not manifest.is_file() or manifest.is_symlink():
        raise InputError(
            f"{data}: no {MANIFEST}",
            found="a link" if manifest.is_symlink() else None,
            expected="a folder that `hydroviews build` has finished",
            fix="run the build again",
        )
    if one:
        return _check_scene(data.resolve(), one, every_view)
    scenes = read_manifest(data)["scenes"]
    problems = check_folder(data, scenes)
    for scene, entry in scenes.items():
        problems += _check_scene(data / scene, entry, every_view)
    return problems


def _check_scene(folder: Path, entry: Mapping[str, Any], every_view: bool) -> list[str]:
    """What is wrong with a scene; one with links out of it is not looked into."""
    if folder.is_symlink():
        return []  # told of the data folder
    problems = check_files(folder, entry)
    if has_links(folder, entry):
        return problems
    sound = not problems
    problems += check_cameras(folder, entry)
    for pattern in entry["patterns"]:
        problems += check_rain(folder, pattern, every_view)
    if sound and not _tell_generator(folder, entry):
        problems += check_drawing(folder, entry, every_view)
    return problems


def _tell_generator(folder: Path, entry: Mapping[str, Any]) -> bool:
    """Whether another generator drew the scene: no problem, a remark, since today's code would draw it otherwise.

    It is as good as ever.
    """
    try:
        outdated = drawn_otherwise(folder, entry["patterns"])
    except InputError as error:  # a damaged file, which the other checks find
        logger.warning("%s", error)
        return True
    if outdated:
        what = ", ".join(outdated)
        logger.warning("%s: %s: drawn by another generator than this one; layers were not drawn again", folder, what)
    return bool(outdated)
