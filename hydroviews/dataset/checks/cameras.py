"""Whether a scene's cameras, split and pictures fit each other: `transforms.json` is `sparse/0` once more."""

import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hydroviews.dataset.clean_views import CLEAN
from hydroviews.dataset.rainy_variant import SHARED, same_values
from hydroviews.dataset.variants import has_clean, is_captured, open_clean, open_variant, shown_views
from hydroviews.errors import InputError
from hydroviews.files.atomic import read_json, sha256
from hydroviews.formats.capture_json import CAPTURED
from hydroviews.formats.nerfstudio import CAMERA_FILE
from hydroviews.formats.photographs import SPLIT, some
from hydroviews.formats.writers import MODEL, POINT_CLOUD, write_nerfstudio
from hydroviews.scene.images import list_images
from hydroviews.scene.scenes import Scene


def check_cameras(folder: Path, entry: Mapping[str, Any]) -> list[str]:
    """What is wrong with the cameras, the split and the sets of pictures of a scene that has no links out of it."""
    try:
        scene = open_variant(folder, CAPTURED) if is_captured(folder) else open_clean(folder)
    except InputError as error:
        return [str(error)]
    names = {view.name for view in scene.views}
    problems = []
    neither = sorted(names - {*scene.split.train, *scene.split.test})
    if neither:
        problems.append(f"{folder / SPLIT}: views that are neither to train on nor held out: {some(neither)}")
    variants = [CAPTURED] if is_captured(folder) else entry["patterns"]
    pictures = [f"{variant}/images" for variant in variants]
    for images in [CLEAN, *pictures] if has_clean(folder) or not is_captured(folder) else pictures:
        problems += _check_names(folder / images, {view.name for view in shown_views(folder, images, scene)})
    problems += _check_transforms(folder, scene, f"{CAPTURED}/images" if is_captured(folder) else CLEAN)
    for variant in variants:
        problems += _check_transforms(folder / variant, scene, "images") + _check_shared(folder, folder / variant)
    return problems


def _check_names(images: Path, names: set[str]) -> list[str]:
    """Is there a picture of each of the views?"""
    absent = sorted(names - {path.stem for path in list_images(images)}) if images.is_dir() else []
    return [f"{images}: no picture of {some(absent)}"] if absent else []


def _check_transforms(project: Path, scene: Scene, images: str) -> list[str]:
    """Does `transforms.json` hold the cameras of the scene?"""
    path = project / CAMERA_FILE
    with tempfile.TemporaryDirectory(prefix="hydroviews-") as folder:
        write_nerfstudio(scene, Path(folder) / CAMERA_FILE, images)
        expected = read_json(Path(folder) / CAMERA_FILE)
    try:
        found = read_json(path)
    except InputError as error:
        return [str(error)]
    cloud = (MODEL / POINT_CLOUD).as_posix()
    if isinstance(found, dict) and found.get("ply_file_path") == cloud:
        expected = {"ply_file_path": cloud, **expected}
    return [] if same_values(found, expected) else [f"{path}: not the cameras of {MODEL}{_first(found, expected)}"]


def _first(found: Any, expected: Mapping[str, Any]) -> str:
    """Where the first frame is that differs, if the files are alike otherwise."""
    frames = found.get("frames") if isinstance(found, dict) else None
    if not isinstance(frames, list) or len(frames) != len(expected["frames"]):
        return ""
    pairs = zip(frames, expected["frames"], strict=True)
    return next((f": {theirs['file_path']}" for ours, theirs in pairs if not same_values(ours, theirs)), "")


def _check_shared(folder: Path, variant: Path) -> list[str]:
    """Does a variant have the scene's cameras and masks, by links or as copies?"""
    problems = []
    for name in SHARED:
        ours, theirs = folder / name, variant / name
        if ours.is_dir() and not theirs.is_symlink() and _contents(theirs) != _contents(ours):
            problems.append(f"{theirs}: not the scene's {name}; remove it and run the build again")
    return problems


def _contents(folder: Path) -> dict[str, str]:
    files: Sequence[Path] = [path for path in folder.rglob("*") if path.is_file()]
    return {path.relative_to(folder).as_posix(): sha256(path) for path in files}
