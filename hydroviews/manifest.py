"""The list of what a data set holds: a SHA-256 for every file, and what made it."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tqdm import tqdm

import hydroviews
from hydroviews.errors import InputError
from hydroviews.files import sha256, write_json

MANIFEST = "manifest.json"
GENERATOR = f"hydroviews {hydroviews.__version__}"


def read_manifest(data: Path) -> dict[str, Any]:
    """The manifest of a data folder; an empty one where nothing has been finished yet.

    Raises:
        InputError: the file is not a manifest.
    """
    path = data / MANIFEST
    if not path.is_file():
        return {"generator": GENERATOR, "scenes": {}}
    fix = "delete it and build again: finished files are kept"
    try:
        manifest = json.loads(path.read_text())
    except ValueError as error:
        raise InputError(f"{path}: not valid JSON", found=error, fix=fix) from None
    scenes = manifest.get("scenes") if isinstance(manifest, dict) else None
    if not isinstance(scenes, dict) or not all({"files", "patterns"} <= set(entry) for entry in scenes.values()):
        raise InputError(f"{path}: not a manifest", expected='{"scenes": {name: {"files", "patterns", ...}}}', fix=fix)
    return manifest


def record_scene(data: Path, scene: str, facts: Mapping[str, Any]) -> None:
    """Hash every file of a finished scene and enter it in the manifest."""
    folder = data / scene
    files = {}
    for path in tqdm(scene_files(folder), desc=f"{scene}: checksums", unit="file", leave=False):
        files[path.relative_to(folder).as_posix()] = sha256(path)
    manifest = read_manifest(data)
    manifest["generator"] = GENERATOR
    manifest["scenes"][scene] = {**facts, "files": files}
    write_json(data / MANIFEST, manifest)


def forget_scene(data: Path, scene: str) -> None:
    """Take a scene out of the manifest, before its files are."""
    manifest = read_manifest(data)
    if manifest["scenes"].pop(scene, None):
        write_json(data / MANIFEST, manifest)


def scene_files(folder: Path) -> list[Path]:
    """Every finished file of a scene, sorted.

    Links (each variant's `sparse`) and hidden names (partial files, baked lenses) are left out.
    """
    return [path for path in sorted(folder.rglob("*")) if path.is_file() and not _hidden_or_linked(path, folder)]


def _hidden_or_linked(path: Path, folder: Path) -> bool:
    inside = [path, *path.parents]
    inside = inside[: inside.index(folder)]
    return any(part.name.startswith(".") or part.is_symlink() for part in inside)
