"""Splits that captures have in forms of their own, so that scores are those of others.

| where | form |
|---|---|
| `transforms.json` | nerfstudio: `train_filenames`, `val_filenames`, `test_filenames` |
| `transforms_train.json`, `transforms_val.json`, `transforms_test.json` | Blender |
| `train_list.txt`, `test_list.txt` | nerfbaselines: a name a line |
| one `*.tsv` | NeRF in the wild: columns `filename` and `split` |

Views of neither part, such as those of a third one, are left out.
"""

import csv
import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from hydroviews.errors import InputError
from hydroviews.files.atomic import as_file, is_there
from hydroviews.formats.nerfstudio import CAMERA_FILE, part_files, part_names
from hydroviews.formats.photographs import below_first, composed_stem, read_split
from hydroviews.scene.scenes import Scene, Split, View, make_scene

logger = logging.getLogger(__name__)

LISTS = "{}_list.txt"


def with_own_split(scene: Scene, folder: Path) -> Scene:
    """The scene with the split that its capture has, and a note; as it is where there is none, or a `split.json`.

    Raises:
        InputError: a file of the split cannot be read.
    """
    if scene.clean_views or read_split(folder) is not None:
        return scene
    where, parts = _stated(folder)
    if not parts:
        return scene
    train, test = _chosen(scene.views, folder, parts)
    if len(train) < 2 or not test:
        logger.warning(
            "%s: the split of %s is not used, as %d of its training views and %d of those held out are there",
            folder, where, len(train), len(test),
        )  # fmt: skip
        return scene
    kept = [view for view in scene.views if view.name in {*train, *test}]
    left_out = len(scene.views) - len(kept)
    note = f"split of {where}: {len(train)} views to train on, {len(test)} held out"
    note += f"; {left_out} in neither left out" if left_out else ""
    made = make_scene(scene.name, kept, scene.points, Split(tuple(sorted(train)), tuple(sorted(test))))
    return replace(scene, views=made.views, split=made.split, notes=(*scene.notes, note))


def _stated(folder: Path) -> tuple[str, Mapping[str, Sequence[str]]]:
    """Where a split stands, and the names of each of its parts; no parts where there is none."""
    parts = part_names(folder)
    if parts:
        return ", ".join(path.name for path in part_files(folder).values()) or CAMERA_FILE, parts
    lists = {part: folder / LISTS.format(part) for part in ("train", "test")}
    if all(is_there(path) for path in lists.values()):
        return ", ".join(path.name for path in lists.values()), {part: _lines(path) for part, path in lists.items()}
    tables = sorted(path for path in folder.glob("*.tsv") if not path.name.startswith("."))
    if len(tables) == 1 and (table := _table(tables[0])):
        return tables[0].name, table
    return "", {}


def _lines(path: Path) -> list[str]:
    return [line.strip() for line in _text(path).splitlines() if line.strip()]


def _table(path: Path) -> dict[str, list[str]]:
    """Names by part; those without one are in none. Empty where the table has no such columns."""
    parts: dict[str, list[str]] = {}
    for row in csv.DictReader(_text(path).splitlines(), delimiter="\t"):
        if row.get("filename") and row.get("split"):
            parts.setdefault(str(row["split"]).strip().lower(), []).append(str(row["filename"]).strip())
    return parts if "train" in parts else {}


def _text(path: Path) -> str:
    try:
        return as_file(path).read_text("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not UTF-8", found=error, fix="save the file as UTF-8, or remove it") from None


def _chosen(views: Sequence[View], folder: Path, parts: Mapping[str, Sequence[str]]) -> tuple[set[str], set[str]]:
    """Names of the views to train on and of those held out: by the part for tests, else that for validation."""
    by_name: dict[str, str] = {}
    for view in reversed(views):
        path = view.path.relative_to(folder) if view.path.is_relative_to(folder) else Path(view.path.name)
        for name in (view.path.name, str(below_first(path)), path.as_posix()):
            by_name[composed_stem(name)] = view.name

    def found(part: str) -> set[str]:
        names = [composed_stem(Path(name.replace("\\", "/")).as_posix()) for name in parts.get(part, ())]
        return {by_name[name] for name in names if name in by_name}

    test = found("test") or found("val") or found("validation")
    train = found("train") or ({view.name for view in views} - test - found("val"))
    return train - test, test
