"""The list of what a data set holds: a SHA-256 for every file of every scene, and what drew it."""

import hashlib
import os
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path, PurePosixPath
from typing import Any

from tqdm import tqdm

from hydroviews.cli.threads import side_by_side
from hydroviews.errors import InputError
from hydroviews.files.atomic import edit_bytes, is_there, json_bytes, read_json
from hydroviews.files.known_bytes import current_sha256, read_only, require_bytes
from hydroviews.files.locks import locked
from hydroviews.files.ownership import is_claimed, left_by_others
from hydroviews.formats.capture_json import CAPTURED

MANIFEST = "manifest.json"
HELD_BACK = "held_back"  # names of views whose pictures are not in this data folder (see `lending`)
SHAPE = '{"scenes": {name: {"files": {path in the scene: SHA-256}, "patterns": [names], ...}}}'


def read_manifest(data: Path) -> dict[str, Any]:
    """The manifest of a data folder; an empty one where nothing has been finished yet.

    Every name in it is one of a file or folder below the data folder.

    Raises:
        InputError: the file is not a manifest.
    """
    path = data / MANIFEST
    if not is_there(path):
        return {"scenes": {}}
    fix = "restore it, or delete it and build again: finished files are kept, as they are now"
    manifest = read_json(path, fix)
    scenes = manifest.get("scenes") if isinstance(manifest, dict) else None
    if not isinstance(scenes, dict):
        raise InputError(f"{path}: not a manifest", expected=SHAPE, fix=fix)
    for name, entry in scenes.items():
        odd = _odd_entry(name, entry)
        if odd:
            raise InputError(f"{path}: not a manifest, scene {name[:80]!r}", found=odd[:200], expected=SHAPE, fix=fix)
    return manifest


def _odd_entry(name: str, entry: Any) -> str:
    """What is wrong with a scene of a manifest; empty if nothing is."""
    if not _is_folder(name):
        return "a name that is no folder's"
    if not (isinstance(entry, dict) and isinstance(entry.get("files"), dict)):
        return "no files"
    patterns = entry.get("patterns")
    if not (isinstance(patterns, list) and all(isinstance(one, str) and _is_folder(one) for one in patterns)):
        return f"patterns {patterns!r}"
    if not isinstance(entry.get(HELD_BACK, []), list):
        return f"{HELD_BACK} {entry[HELD_BACK]!r}"
    odd = [file for file, digest in entry["files"].items() if not (_below(file) and isinstance(digest, str))]
    return f"file {odd[0]!r}" if odd else ""


def _below(name: str) -> bool:
    """Whether a name with forward slashes leads from a folder to something below it."""
    path = PurePosixPath(name)
    plain = path.as_posix() == name and not path.is_absolute() and "\0" not in name
    return plain and name != "." and ".." not in path.parts


def _is_folder(name: str) -> bool:
    return _below(name) and "/" not in name


def scene_entry(scene: Path) -> dict[str, Any] | None:
    """What the manifest beside a built scene says of it; None where no manifest lists it.

    Raises:
        InputError: the manifest is none.
    """
    for folder in (Path(os.path.abspath(scene)), scene.resolve()):  # as it is called, then what a link leads to
        entry: dict[str, Any] | None = read_manifest(folder.parent)["scenes"].get(folder.name)
        if entry is not None:
            return entry
    return None


def require_outside_scenes(folder: Path) -> None:
    """Refuse a folder for other results in a built scene, whose files would count as the scene's own.

    Raises:
        InputError: the folder lies in a scene that a manifest lists.
    """
    folder = Path(os.path.abspath(folder))
    for one in (folder, *folder.parents):
        try:
            entry = scene_entry(one)
        except InputError:  # somebody else's manifest.json
            continue
        if entry is not None:
            raise InputError(
                f"{folder}: in the built scene {one}", fix="choose another --out, outside of the data folder"
            )


def listed_files(scene: Path, entry: Mapping[str, Any]) -> dict[Path, str]:
    """The files of a scene's entry, with the SHA-256 that each must have."""
    return {scene / name: digest for name, digest in entry["files"].items()}


def known_file(scene: Path, name: str) -> Path:
    """A file of a finished scene, to be read.

    Raises:
        InputError: the manifest does not list it, or it is missing or changed.
    """
    entry = scene_entry(scene)
    if entry is None or name not in entry["files"]:
        raise InputError(f"{scene / name}: not in the manifest", fix="build the scene first")
    return require_bytes(scene / name, entry["files"][name])


def changed_files(listed: Mapping[Path, str], title: str) -> list[Path]:
    """Those of some files that are there and do not have the SHA-256 they must, in order; two are hashed at a time."""
    there = [path for path in listed if path.is_file()]
    digests = side_by_side(current_sha256, there)
    return [
        path for path, digest in zip(there, _shown(digests, title, len(there)), strict=True) if digest != listed[path]
    ]


def _shown(digests: Iterable[str], title: str, total: int) -> Iterable[str]:
    return tqdm(digests, desc=f"{title}: checksums", total=total, unit="file", leave=False, disable=not total)


def record_scene(data: Path, scene: str, facts: Mapping[str, Any], kept: Mapping[str, str] | None = None) -> None:
    """Enter a finished scene in the manifest, but rain that is not in the facts, and let nobody write into its files.

    Rain that is not in the facts was begun and not ended; `verify` finds it beside what is listed. So it does with
    files that the user put there, which stay as they are.

    Args:
        data: the data folder.
        scene: its name.
        facts: what the manifest says of it beside its files.
        kept: SHA-256 by name of files that were listed before and are not hashed again.
    """
    folder, kept = data / scene, kept or {}
    ended = {folder / name for name in (*facts["patterns"], CAPTURED)}
    begun = {path.parent for path in folder.glob("*/pattern.json")} - ended
    others = set(left_by_others(folder.resolve())) if is_claimed(folder) else set()
    ours = [path for path in scene_files(folder) if path.resolve() not in others]
    finished = [path for path in ours if not begun.intersection(path.parents)]
    new = [name for path in finished if (name := path.relative_to(folder).as_posix()) not in kept]
    files = {**kept, **_sealed(folder, new)}
    enter_scene(data, scene, facts, files)


def enter_scene(data: Path, scene: str, facts: Mapping[str, Any], files: Mapping[str, str]) -> None:
    """Enter a scene whose files are known by name with their SHA-256."""
    with _changed(data) as manifest:
        manifest["scenes"][scene] = {**facts, "files": _in_order(files)}


def _sealed(folder: Path, names: Collection[str]) -> dict[str, str]:
    """Make files read-only and hash them, two at a time: SHA-256 by name."""
    paths = [folder / name for name in names]
    for path in paths:
        with suppress(PermissionError):  # somebody else's
            read_only(path)
    digests = _shown(side_by_side(current_sha256, paths), folder.name, len(paths))
    return dict(zip(names, digests, strict=True))


def _in_order(files: Mapping[str, str]) -> dict[str, str]:
    return dict(sorted(files.items(), key=lambda item: Path(item[0])))


def forget_scene(data: Path, scene: str) -> None:
    """Take a scene out of the manifest, before its files are."""
    if scene in read_manifest(data)["scenes"]:
        with _changed(data) as manifest:
            manifest["scenes"].pop(scene, None)


def record_files(data: Path, scene: str, names: Sequence[str]) -> None:
    """Hash a few files of a scene that is in the manifest again, such as a card that was written anew."""
    hashes = _sealed(data / scene, names)
    with _changed(data) as manifest:
        manifest["scenes"][scene]["files"] = _in_order(manifest["scenes"][scene]["files"] | hashes)


@contextmanager
def _changed(data: Path) -> Iterator[dict[str, Any]]:
    """The manifest, written when the block ends; no other process changes it meanwhile."""
    with locked(data / MANIFEST):
        manifest = read_manifest(data)
        yield manifest
        edit_bytes(data / MANIFEST, json_bytes(manifest))


def data_hash(data: Path, scene: str, pattern: str) -> str:
    """SHA-256 over the hashes of what a run is trained and scored on.

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
    return any(step.name.startswith(".") or step.is_symlink() for step in steps_below(folder, path))


def steps_below(folder: Path, path: Path) -> list[Path]:
    """A path below a folder, and the folders between the two."""
    steps = [path, *path.parents]
    return steps[: steps.index(folder)]
