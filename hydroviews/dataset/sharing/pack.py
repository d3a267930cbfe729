"""Packs the variants of a data folder: an archive each, and beside it the metadata that describe the archive.

<out>/courtyard-raindrop-1.zip              clean and rainy views, cameras, split, layers, card, licence, manifest
<out>/courtyard-raindrop-1.croissant.json   Croissant metadata with the archive's SHA-256
"""

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from hydroviews.dataset.clean_views import CLEAN
from hydroviews.dataset.manifest import MANIFEST, built_scenes, scene_entry
from hydroviews.dataset.request import REQUEST
from hydroviews.dataset.sharing.archive import LEFT_OUT, refuse_odd_names, write_archive
from hydroviews.dataset.sharing.contents import IMAGES, LAYERS, Contents, contents, variants_of
from hydroviews.dataset.sharing.croissant import CROISSANT, FileFacts, Pictures, croissant
from hydroviews.errors import InputError, unknown_name
from hydroviews.files.atomic import json_bytes, read_json, replacing, sha256, write_json
from hydroviews.files.locks import BUSY, locked
from hydroviews.formats.capture_json import CAPTURED
from hydroviews.formats.photographs import SPLIT
from hydroviews.rain.patterns import PATTERN_FILE

ZIP = ".zip"
RENAME = "rename the capture's folder or that photograph, and build the scene again"
NOTHING: Mapping[str, Any] = {"files": {}, "patterns": []}


def pack(
    data: Path,
    out: Path,
    *,
    scene: str = "",
    patterns: Sequence[str] = (),
    owner_says: str = "",
    layers_only: bool = False,
) -> Iterator[tuple[Path, str]]:
    """Write an archive for every variant, one more for the clean views alone, and the metadata of each.

    A scene that is being built is waited for. The same data give the same bytes.

    Args:
        data: a data folder, or a built scene in one.
        out: the folder for the archives; or the archive itself, `*.zip`, where there is one to write.
        scene: only the one of that name; all if empty.
        patterns: only these variants; "clean" is one.
        owner_says: see `contents`.
        layers_only: see `contents`.

    Yields:
        Archives as they are finished, with their SHA-256.

    Raises:
        InputError: nothing to pack, a build that is not finished, a file that is not what the manifest says, a licence
            that does not allow it, a name that cannot be unpacked everywhere, another archive of that name, or a full
            disk.
    """
    folders = built_scenes(data, scene)
    if not scene and (data / MANIFEST).is_file():
        _refuse_unfinished(data)
    wanted = [(folder, name) for folder in folders for name in _chosen(folder, patterns, layers_only)]
    if out.suffix == ZIP and len(wanted) != 1:
        names = ", ".join(f"{folder.name}-{variant}" for folder, variant in wanted)
        raise InputError(f"--out {out}: one archive, for {len(wanted)} variants", found=names, fix="name a folder")
    for folder, variant in wanted:
        with locked(folder, BUSY):
            entry = scene_entry(folder)
            if entry is None or variant not in variants_of(entry):
                raise _unfinished(folder)
            packed = contents(folder, variant, entry, owner_says, layers_only)
            path = out if out.suffix == ZIP else out / f"{packed.name}{ZIP}"
            yield path, _write(packed, path)


def _chosen(folder: Path, patterns: Sequence[str], layers_only: bool) -> list[str]:
    """The names of a scene's variants that are wanted; only drawn rain has layers."""
    entry = scene_entry(folder)
    there = [name for name in variants_of(entry or NOTHING) if not (layers_only and name in (CLEAN, CAPTURED))]
    for name in set(patterns) - set(there):
        if (folder / name / PATTERN_FILE).is_file():
            raise _unfinished(folder / name)
        raise unknown_name(f"--patterns {name}", name, f"variant of {folder}", there)
    return [name for name in there if not patterns or name in patterns]


def _refuse_unfinished(data: Path) -> None:
    finished = {folder.name for folder in built_scenes(data)}
    for request in sorted(data.glob(f"[!.]*/{REQUEST}")):
        if request.parent.name not in finished:
            raise _unfinished(request.parent)


def _unfinished(folder: Path) -> InputError:
    return InputError(
        f"{folder}: its build is not finished",
        fix="run the build again, remove that folder, or pack the finished scenes with --scene NAME",
    )


def _write(packed: Contents, path: Path) -> str:
    """Write archive and metadata; what is there already stays if it is the same."""
    here: dict[str, Path | bytes] = {name: packed.files[name] for name in sorted(packed.files.keys() - packed.left_out)}
    hashes = {name: _digest(packed, name) for name in sorted(packed.files)}
    entry = {**packed.facts, "files": hashes}
    manifest = json_bytes({"scenes": {packed.folder.name: entry}, LEFT_OUT: sorted(packed.left_out)})
    described = FileFacts(MANIFEST, "application/json", len(manifest), _sha256(manifest))
    members: dict[str, Path | bytes] = {MANIFEST: manifest, CROISSANT: json_bytes(_metadata(packed, described, here))}
    members |= {f"{packed.folder.name}/{name}": content for name, content in here.items()}
    refuse_odd_names(path, members, RENAME)
    with replacing(path) as temporary:
        known = {f"{packed.folder.name}/{name}": hashes[name] for name in here}
        digest = write_archive(temporary, path.name, members, known)
        if path.is_file() and sha256(path) != digest:
            raise InputError(
                f"{path}: another archive is there", fix="choose another --out, or remove it: it may be published"
            )
        size = temporary.stat().st_size
    archive = FileFacts(path.name, "application/zip", size, digest)
    write_json(path.with_suffix(f".{CROISSANT}"), _metadata(packed, archive, here))
    return digest


def _digest(packed: Contents, name: str) -> str:
    content = packed.files[name]
    return _sha256(content) if isinstance(content, bytes) else packed.hashes[name]


def _metadata(packed: Contents, file: FileFacts, here: Mapping[str, Any]) -> dict[str, Any]:
    scene = packed.folder.name
    folders = [
        Pictures("rainy", f"{scene}/{packed.variant}/{IMAGES}/*.png", "image/png", "The view in rain, sRGB."),
        Pictures("clean", f"{scene}/{CLEAN}/*.png", "image/png", "The same view without rain, sRGB."),
        Pictures("layers", f"{scene}/{packed.variant}/{LAYERS}/*.exr", "image/x-exr", "What rain added: half floats."),
    ]
    there = {str(Path(f"{scene}/{name}").parent) for name in here}
    folders = [one for one in folders if one.glob.rpartition("/")[0] in there]
    rainy = f"rain {packed.variant}" if packed.variant != CLEAN else "without rain"
    words = (
        f"Multi-view data set {scene}, {packed.facts['views']} views, {rainy}: cameras, split, "
        f"{', '.join(one.name for one in folders) or 'parameters'}. The card is {scene}/README.md."
    )
    licence = packed.licence.text if packed.licence else "The photographs' licence is not stated; none are included."
    split = read_json(packed.folder / SPLIT)
    version = str(packed.facts["generator"]).split()[-1]
    return croissant(packed.name, words, licence, version, file, folders, split)


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
