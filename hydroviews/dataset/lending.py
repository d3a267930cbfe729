"""What a method may see of a scene, in a data folder of its own: cameras, points, split, and the training views.

    <lent>/manifest.json                 lists what is lent, and which views are held back
    <lent>/<scene>/split.json, sparse/0
    <lent>/<scene>/<pattern>/images/*.png, or clean/*.png
    <lent>/<scene>/masks, depth, captured-0/drops    where the scene has them

Files are copies: who may write into a hard link writes into the data set. It is opened as the scene itself is
(`variants`); of a view that is held back there is a camera and no picture.
"""

import shutil
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tqdm import tqdm

from hydroviews.cli.threads import side_by_side
from hydroviews.dataset.clean_views import CLEAN
from hydroviews.dataset.drop_masks import BUILT as DROPS
from hydroviews.dataset.manifest import HELD_BACK, MANIFEST, changed_files, listed_files, scene_entry
from hydroviews.errors import InputError
from hydroviews.files.atomic import write_json
from hydroviews.files.full_disk import plain_full_disk
from hydroviews.files.known_bytes import current_sha256, read_only, require_bytes
from hydroviews.files.temporary import temporary_beside
from hydroviews.formats.capture_json import CAPTURED
from hydroviews.formats.photographs import SPLIT
from hydroviews.formats.writers import MODEL
from hydroviews.scene.depth import FOLDER as DEPTH
from hydroviews.scene.masks import MASKS, mask_name


@dataclass(frozen=True)
class Loan:
    """A data folder that is lent, and the SHA-256 that its files must have by their paths."""

    data: Path
    files: Mapping[Path, str]

    def spoilt(self) -> list[str]:
        """Names of the files that are no longer what was lent."""
        gone = [path for path in self.files if not path.is_file()]
        return [path.name for path in gone + changed_files(self.files, "what was lent")]


@contextmanager
def lend(
    scene: Path,
    pattern: str,
    train: Collection[str],
    held_back: Collection[str],
    near: Path,
    cameras: Path | None = None,
) -> Iterator[Loan]:
    """Lend the training views of a scene until the block ends.

    Args:
        scene: the folder of a finished scene.
        pattern: a variant's name, or "clean".
        train: names of the views that are lent.
        held_back: names of the others.
        near: where to make the folder: a hidden one beside this path.
        cameras: a folder with a model and a split that are lent in place of the scene's.

    Raises:
        InputError: the scene is not in a manifest, a file is not what the manifest says, or the disk is full.
    """
    entry = scene_entry(scene)
    if entry is None:
        raise InputError(f"{scene}: no finished scene", fix="build it first")
    names = _lent_names(entry, pattern, train)
    files = {name: digest for name, digest in entry["files"].items() if name in names}
    origins = dict.fromkeys(files, scene)
    if cameras:
        files = {name: digest for name, digest in files.items() if not _is_camera_file(name)}
        own = {path.relative_to(cameras).as_posix() for path in (cameras / SPLIT, *(cameras / MODEL).iterdir())}
        files |= {name: current_sha256(cameras / name) for name in sorted(own)}
        origins |= dict.fromkeys(own, cameras)
    said = {"files": files, "patterns": [name for name in entry["patterns"] if name == pattern]}
    with temporary_beside(near) as data:
        with plain_full_disk(near):
            _copy(origins, files, data / scene.name)
            write_json(data / MANIFEST, {"scenes": {scene.name: {**said, HELD_BACK: list(held_back)}}})
        yield Loan(data, listed_files(data / scene.name, {"files": files}))


def _lent_names(entry: Mapping[str, Any], pattern: str, train: Collection[str]) -> set[str]:
    """Names of the files that are lent, as far as there are any."""
    images = CLEAN if pattern == CLEAN else f"{pattern}/images"
    names = {name for name in entry["files"] if _is_camera_file(name)}
    names |= {f"{images}/{view}.png" for view in train}
    names |= {f"{MASKS}/{mask_name(f'{view}.png')}" for view in train}
    names |= {f"{DEPTH}/{view}.exr" for view in train if pattern == CLEAN}
    return names | {f"{CAPTURED}/{DROPS}/{view}.png" for view in train if pattern == CAPTURED}


def _is_camera_file(name: str) -> bool:
    return name == SPLIT or name.startswith(f"{MODEL.as_posix()}/")


def _copy(origins: Mapping[str, Path], files: Mapping[str, str], target: Path) -> None:
    """Copy files, each from its folder, read-only and two at a time, showing progress."""
    for folder in {(target / name).parent for name in files}:
        folder.mkdir(parents=True, exist_ok=True)

    def copy(name: str) -> None:
        shutil.copyfile(require_bytes(origins[name] / name, files[name]), target / name)
        read_only(target / name)

    copies = side_by_side(copy, files)
    list(tqdm(copies, desc=f"{target.name}: lending views", total=len(files), unit="file", leave=False))
