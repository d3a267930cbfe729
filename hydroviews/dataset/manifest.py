"""The list of what a data set holds: a SHA-256 for every file of every scene, and what drew it."""

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tqdm import tqdm

from hydroviews.errors import InputError
from hydroviews.files.atomic import locked, sha256, write_json
from hydroviews.formats.capture_json import CAPTURED

MANIFEST = "manifest.json"


def read_manifest(data: Path) -> dict[str, Any]:
    """The manifest of a data folder; an empty one where nothing has been finished yet.

    Raises:
        InputError: the file is not a manifest.
    """
    path = data / MANIFEST
    if not path.is_file():
        return {"scenes": {}}
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
    """Hash every file of a finished scene and enter it in the manifest, but those of rain that is not in the facts.

    Such a variant was begun and not ended; `verify` finds it beside what is listed.
    """
    folder = data / scene
    ended = {folder / name for name in (*facts["patterns"], CAPTURED)}
    begun = {path.parent for path in folder.glob("*/pattern.json")} - ended
    finished = [path for path in scene_files(folder) if not begun.intersection(path.parents)]
    files = {}
    for path in tqdm(finished, desc=f"{scene}: checksums", unit="file", leave=False):
        files[path.relative_to(folder).as_posix()] = sha256(path)
    with _changed(data) as manifest:
        manifest["scenes"][scene] = {**facts, "files": files}


def forget_scene(data: Path, scene: str) -> None:
    """Take a scene out of the manifest, before its files are."""
    if scene in read_manifest(data)["scenes"]:
        with _changed(data) as manifest:
            manifest["scenes"].pop(scene, None)


def record_files(data: Path, scene: str, names: Sequence[str]) -> None:
    """Hash a few files of a scene that is in the manifest again, such as a card that was written anew."""
    hashes = {name: sha256(data / scene / name) for name in names}
    with _changed(data) as manifest:
        files = manifest["scenes"][scene]["files"] | hashes
        manifest["scenes"][scene]["files"] = dict(sorted(files.items(), key=lambda item: Path(item[0])))


@contextmanager
def _changed(data: Path) -> Iterator[dict[str, Any]]:
    """The manifest, written when the block ends; no other process changes it meanwhile."""
    with locked(data / MANIFEST):
        manifest = read_manifest(data)
        yield manifest
        write_json(data / MANIFEST, manifest)


def data_hash(data: Path, scene: str, pattern: str) -> str:
    """SHA-256 over the hashes of what a method sees.

    That is clean views, cameras, split, masks, and the variant's images and drop masks.

    Raises:
        InputError: the manifest does not list the scene.
    """
    scenes = read_manifest(data)["scenes"]
    if scene not in scenes:
        raise InputError(f"{data}: no finished scene {scene}", found=", ".join(scenes) or "none", fix="build it first")
    seen = ("clean/", "sparse/", "split.json", "masks/", f"{pattern}/images/", f"{pattern}/drops/")
    lines = sorted(f"{digest} {name}" for name, digest in scenes[scene]["files"].items() if name.startswith(seen))
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()


def built_scenes(folder: Path, scene: str = "") -> list[Path]:
    """The finished scenes of a data folder, or the one that `folder` is itself.

    Args:
        folder: a data folder, or a scene in one.
        scene: only the one of that name; all if empty.

    Raises:
        InputError: there is no such scene.
    """
    data, only = (folder, scene) if (folder / MANIFEST).is_file() else (folder.resolve().parent, folder.resolve().name)
    names = [name for name in read_manifest(data)["scenes"] if only in ("", name)]
    if not names:
        raise InputError(
            f"{folder}: no finished scene {scene}".rstrip(),
            found=", ".join(read_manifest(data)["scenes"]) or f"no {MANIFEST}",
            expected="a data folder that `hydroviews build` wrote, or a scene in it",
        )
    return [data / name for name in names]


def scene_files(folder: Path) -> list[Path]:
    """Every finished file of a scene, sorted.

    Links (each variant's `sparse`) and hidden names (partial files, baked lenses) are left out.
    """
    return [path for path in sorted(folder.rglob("*")) if path.is_file() and not _hidden_or_linked(path, folder)]


def _hidden_or_linked(path: Path, folder: Path) -> bool:
    inside = [path, *path.parents]
    inside = inside[: inside.index(folder)]
    return any(part.name.startswith(".") or part.is_symlink() for part in inside)
