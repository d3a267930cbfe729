"""The list of what a data set holds: a SHA-256 for every file, and what made it."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tqdm import tqdm

import hydroviews
from hydroviews.files import PARTIAL, read_json, sha256, write_json

MANIFEST = "manifest.json"
GENERATOR = f"hydroviews {hydroviews.__version__}"


def read_manifest(data: Path) -> dict[str, Any]:
    """The manifest of a data folder; an empty one where nothing has been finished yet."""
    path = data / MANIFEST
    return read_json(path) if path.is_file() else {"generator": GENERATOR, "scenes": {}}


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


def scene_files(folder: Path) -> list[Path]:
    """Every finished file of a scene; links (each variant's `sparse`) and partial files are left out."""
    found = []
    for path in sorted(folder.rglob("*")):
        inside = path.relative_to(folder).parts
        linked = any((folder / Path(*inside[: i + 1])).is_symlink() for i in range(len(inside)))
        if path.is_file() and not linked and not path.name.startswith(PARTIAL):
            found.append(path)
    return found
