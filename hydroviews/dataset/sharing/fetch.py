"""Takes a packed variant, from a server or a disk, into a data folder, where it is then as if it had been built there.

What arrives is kept in hidden files of the data folder, so that a later call goes on where an interrupted one ended. A
scene appears when all of it is there and compared with the archive's manifest; a variant of a scene that is there
already is added to it, if both have the same clean views, cameras and split.
"""

import hashlib
import os
import shlex
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path, PurePosixPath
from typing import Any

from tqdm import tqdm

from hydroviews.captures.download.archives import refuse_if_too_large
from hydroviews.dataset.card.card import CARD, LOSSES, write_card
from hydroviews.dataset.card.markdown import CAPTURED_EFFECT
from hydroviews.dataset.checks.rain import read_facts
from hydroviews.dataset.clean_views import CLEAN
from hydroviews.dataset.manifest import changed_files, enter_scene, read_manifest, scene_files
from hydroviews.dataset.rainy_variant import link_shared
from hydroviews.dataset.request import REQUEST
from hydroviews.dataset.sharing.archive import Packed, open_archive
from hydroviews.dataset.sharing.contents import IMAGES, LAYERS
from hydroviews.dataset.sharing.download import archive_on_disk
from hydroviews.dataset.sharing.fetched import FETCHED
from hydroviews.dataset.statistics import STATISTICS, write_statistics, write_summary
from hydroviews.errors import InputError
from hydroviews.files import ownership
from hydroviews.files.atomic import read_json
from hydroviews.files.full_disk import plain_write_errors
from hydroviews.files.known_bytes import changed, current_sha256, read_only
from hydroviews.files.locks import BUSY, locked
from hydroviews.files.temporary import PARTIAL, remove_tree
from hydroviews.formats.capture_json import CAPTURED
from hydroviews.formats.photographs import some
from hydroviews.rain.layers import read_layers
from hydroviews.rain.patterns import PATTERN_FILE
from hydroviews.rain.registry import GROUP, find_effect, parse_pattern, registered_effects
from hydroviews.scene.images import read_image, write_png

SUMMARIES = (CARD, STATISTICS, LOSSES)  # of a scene with all its variants: made anew when one is added
SAME = ("seed", "long_side", "views", "drawing_code", "capture")  # of all variants of a scene
ELSEWHERE = "choose another --out"


def fetch(address: str, data: Path) -> Path:
    """Get an archive, compare all of it with its manifest, and add its variant to a data folder.

    Args:
        address: http(s)://... or a file; `#sha256=...` at its end is the checksum that the archive must have.
        data: the data folder; it need not exist.

    Returns:
        The scene's folder. If the variant is there already, nothing is written.

    Raises:
        BadArchive: the archive is damaged, or could do harm.
        InputError: it cannot be had, its rain is of an effect that is not installed, another scene of that name is
            there, or the disk is full.
    """
    with archive_on_disk(address, data) as path:
        packed = open_archive(path)
        folder = data / packed.scene
        with locked(folder, BUSY):
            _take_in(packed, data, folder)
    return folder


def _take_in(packed: Packed, data: Path, folder: Path) -> None:
    _require_installed(packed, (name.replace(":", ".").rpartition("-")[0] for name in packed.entry["patterns"]))
    entry = read_manifest(data)["scenes"].get(packed.scene)
    there = _compared(packed, folder, entry)
    missing = [name for name in packed.entry["files"] if name not in there]
    if entry and not set(missing) - set(SUMMARIES) and set(packed.entry["patterns"]) <= set(entry["patterns"]):
        return
    staged = data / f"{PARTIAL}fetched-{_digest(packed)}" / packed.scene
    unpacked = [name for name in missing if name in packed.places]
    _stage(packed, staged, unpacked)
    _require_installed(
        packed, (_effect(staged / name) for name in unpacked if PurePosixPath(name).name == PATTERN_FILE)
    )
    _composite(packed, folder, staged, [name for name in missing if name in packed.left_out])
    with plain_write_errors(folder):
        _move(staged, folder, missing)
    _finish(packed, data, folder, entry)
    remove_tree(staged.parent)


def _require_installed(packed: Packed, effects: Iterable[str]) -> None:
    """Refuse effects of somebody's own: they are imported by their names, and an archive must not say what runs here.

    Raises:
        InputError: an effect is not registered.
    """
    foreign = set(effects) - {*registered_effects(), CAPTURED_EFFECT}
    if foreign:
        raise InputError(
            f"{packed.path}: rain of an effect that is not installed here",
            found=some(sorted(foreign)),
            expected=f"one of {', '.join(registered_effects())}",
            fix=f"install its package, if you trust it; it has to register the effect (entry points {GROUP})",
        )


def _effect(path: Path) -> str:
    """The effect that a `pattern.json` names; empty for none."""
    facts = read_json(path)
    return str(facts.get("effect", "")) if isinstance(facts, dict) else ""


def _digest(packed: Packed) -> str:
    return hashlib.sha256(repr(sorted(packed.entry["files"].items())).encode()).hexdigest()[:12]


def _compared(packed: Packed, folder: Path, entry: Mapping[str, Any] | None) -> set[str]:
    """Names of the archive's files that the scene's folder has already.

    Raises:
        InputError: the folder holds another scene, or one that is not finished.
    """
    names = packed.entry["files"]
    if not folder.exists():
        return set()
    if entry is None:
        found = [path.relative_to(folder).as_posix() for path in scene_files(folder)]
        if not set(found) <= set(names):
            raise _other(folder, "a scene whose build is not finished", f"run its build again, or {ELSEWHERE}")
    else:
        differing = [key for key in SAME if entry.get(key) != packed.entry.get(key)]
        if differing:
            raise _other(folder, f"another {differing[0]}: {entry.get(differing[0])!r}", ELSEWHERE)
    there = {name for name in names if (folder / name).is_file()}
    kept = {folder / name: names[name] for name in there if name not in (*SUMMARIES, REQUEST)}
    other = changed_files(kept, folder.name)
    if other:
        raise _other(folder, some([path.relative_to(folder).as_posix() for path in other]), ELSEWHERE)
    return there


def _other(folder: Path, found: str, fix: str) -> InputError:
    return InputError(f"{folder}: not the scene of the archive", found=found, expected="the archive's files", fix=fix)


def _stage(packed: Packed, staged: Path, names: Collection[str]) -> None:
    """Unpack files beside where they go; those of an interrupted call are compared and kept."""
    size = sum(packed.places[name][1] for name in names)
    kept = {name for name in names if (staged / name).is_file() and _is(staged / name, packed.entry["files"][name])}
    refuse_if_too_large(staged.parent, size - sum(packed.places[name][1] for name in kept))
    bar = tqdm(total=size, desc=f"unpacking {packed.scene}", unit="B", unit_scale=True)
    with bar, plain_write_errors(staged):
        for name in names:
            if name not in kept:
                (staged / name).parent.mkdir(parents=True, exist_ok=True)
                packed.copy(name, staged / name)
            bar.update(packed.places[name][1])


def _is(path: Path, digest: str) -> bool:
    return current_sha256(path) == digest


def _composite(packed: Packed, folder: Path, staged: Path, names: Collection[str]) -> None:
    """Make rainy views from clean ones that are here and from the archive's layers; no other file can be made.

    Raises:
        InputError: something is missing, or a view comes out otherwise than it was.
    """
    if not names:
        return
    rest = [name for name in names if not _can_be_made(packed, folder, name)]
    if rest:
        raise InputError(
            f"{folder}: the archive leaves out {len(rest)} files that are not here either",
            found=f"no {some(sorted(rest))}",
            expected="the scene, built from the same capture; the archive has no pictures",
            fix=f"build it first: {_command(packed, folder.parent)}",
        )
    for name in tqdm(names, desc=f"{packed.scene}: rainy views", unit="view"):
        path, variant = PurePosixPath(name), staged / PurePosixPath(name).parts[0]
        facts = read_facts(variant / PATTERN_FILE)
        clean, layers = read_image(folder / CLEAN / path.name), read_layers(variant / LAYERS / f"{path.stem}.exr")
        write_png(staged / name, find_effect(facts["effect"]).composite(facts["parameters"], clean, layers))
        if not _is(staged / name, packed.entry["files"][name]):
            raise changed(staged / name, current_sha256(staged / name), packed.entry["files"][name])


def _can_be_made(packed: Packed, folder: Path, name: str) -> bool:
    path = PurePosixPath(name)
    layer = f"{path.parts[0]}/{LAYERS}/{path.stem}.exr"
    return path.match(f"*/{IMAGES}/*.png") and layer in packed.places and (folder / CLEAN / path.name).is_file()


def _command(packed: Packed, data: Path) -> str:
    """The build that makes the scene again in a data folder."""
    entry = packed.entry
    size = ["--long-side", entry["long_side"]] if entry["long_side"] else []
    patterns = ["--patterns", *entry["patterns"]] if entry["patterns"] else []
    options = [entry["source"], "--out", data, *size, "--seed", entry["seed"], *patterns]
    return shlex.join(["hydroviews", "build", *map(str, options)])


def _move(staged: Path, folder: Path, names: Collection[str]) -> None:
    """Move staged files to where they belong: all at once where there is no such folder yet."""
    for name in names:
        read_only(staged / name)
    if not folder.exists():
        ownership.claim(staged)
        ownership.adopt([staged / name for name in names], staged)
        os.replace(staged, folder)
        return
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        ownership.enter(folder / name)
        os.replace(staged / name, folder / name)


def _finish(packed: Packed, data: Path, folder: Path, entry: Mapping[str, Any] | None) -> None:
    """Link what variants share, describe the scene with all its variants, and enter it in the manifest."""
    facts = {key: value for key, value in (entry or {**packed.entry, FETCHED: True}).items() if key != "files"}
    rains = {*facts["patterns"], *packed.entry["patterns"]}
    facts["patterns"] = [pattern.name for pattern in sorted(map(parse_pattern, rains))]
    files = {**packed.entry["files"], **(entry["files"] if entry else {})}
    captured = [CAPTURED] if any(name.startswith(f"{CAPTURED}/") for name in files) else []
    for name in captured or facts["patterns"]:
        link_shared(folder / name)
    for name in facts["patterns"]:
        write_statistics(folder, name)
    write_summary(folder)
    write_card(folder, captured or facts["patterns"], facts["notes"])
    for name in SUMMARIES:
        if (folder / name).is_file():
            read_only(folder / name)
            files[name] = current_sha256(folder / name)
    enter_scene(data, packed.scene, facts, files)
