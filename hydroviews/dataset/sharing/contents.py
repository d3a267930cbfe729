"""What belongs to one variant of a built scene, enough to train on it and to score it, and what may be handed on."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

from hydroviews.dataset.card.card import APACHE, CARD, LICENCE, LOSSES, STATED, Licence, card_text, find_licence
from hydroviews.dataset.clean_views import CLEAN
from hydroviews.dataset.request import REQUEST
from hydroviews.dataset.sharing.fetched import FETCHED
from hydroviews.dataset.statistics import STATISTICS, summarise
from hydroviews.errors import InputError
from hydroviews.files.atomic import json_bytes, read_json
from hydroviews.formats.capture_json import CAPTURED
from hydroviews.formats.nerfstudio import CAMERA_FILE
from hydroviews.formats.photographs import SPLIT
from hydroviews.formats.tables.csv_tables import csv_bytes
from hydroviews.rain.compositing import light_stems
from hydroviews.rain.patterns import PATTERN_FILE
from hydroviews.rain.registry import find_effect

APACHE_TEXT = Path(__file__).with_name(APACHE)
IMAGES, LAYERS = "images", "layers"


@dataclass(frozen=True)
class Contents:
    """A variant as it is packed."""

    folder: Path  # of the built scene
    variant: str  # a pattern's name, CAPTURED, or CLEAN: no rain at all
    facts: Mapping[str, Any]  # what the manifest says of the scene beside its files
    files: Mapping[str, Path | bytes]  # by name in the scene, all that belong to the variant
    hashes: Mapping[str, str]  # SHA-256 of the files that are not made here
    left_out: frozenset[str]  # names of files that are not packed
    licence: Licence | None

    @property
    def name(self) -> str:
        """Of the archive, without suffix."""
        return f"{self.folder.name}-{self.variant}{'-layers' if self.left_out else ''}"


def variants_of(entry: Mapping[str, Any]) -> list[str]:
    """The variants of a finished scene: CLEAN and its patterns, or CAPTURED alone."""
    return (
        [CAPTURED] if any(name.startswith(f"{CAPTURED}/") for name in entry["files"]) else [CLEAN, *entry["patterns"]]
    )


def contents(folder: Path, variant: str, entry: Mapping[str, Any], owner_says: str, layers_only: bool) -> Contents:
    """What of a finished scene belongs to a variant: clean views, cameras and all else that variants share, and it.

    Card, summary of statistics, request and licence are made for it: they name no other variant and no local path.

    Args:
        folder: of the built scene.
        variant: one of `variants_of`.
        entry: what the manifest says of the scene.
        owner_says: the licence, stated by who has the rights; empty if the capture's own word is to hold.
        layers_only: leave out the capture's pictures and all that is made from them.

    Raises:
        InputError: nobody has stated a licence that lets the photographs be handed on.
    """
    licence = Licence(owner_says.strip(), True, "who packed it") if owner_says.strip() else find_licence(folder)
    shareable = licence is not None and licence.shareable
    if not (shareable or layers_only):
        raise _refused(folder, licence)
    others = {name for name in (*variants_of(entry), CAPTURED) if name not in (variant, CLEAN)}
    listed = {name: digest for name, digest in entry["files"].items() if PurePosixPath(name).parts[0] not in others}
    rains = [] if variant == CLEAN else [variant]
    made = _made(folder, rains, entry, licence)
    files = {name: folder / name for name in listed if name not in (*made, CARD, STATISTICS, LOSSES)} | made
    left_out = {name for name in files if layers_only and not is_ours(folder, name, rains, shareable)}
    facts = {key: value for key, value in entry.items() if key not in ("files", FETCHED)}
    facts |= {"notes": _notes(entry), "source": json.loads(made[REQUEST])["source"]}
    facts |= {"patterns": [name for name in rains if name != CAPTURED]}
    return Contents(folder, variant, facts, files, listed, frozenset(left_out), licence)


def _made(folder: Path, rains: list[str], entry: Mapping[str, Any], licence: Licence | None) -> dict[str, bytes]:
    """The files that are written for the archive, by name."""
    request = read_json(folder / REQUEST)
    source = Path(request["source"])
    if source.is_absolute() or request["source"].startswith("."):
        request["source"] = f"./{source.name}"  # a folder, wherever it is
    files = {REQUEST: json_bytes(request), CARD: card_text(folder, rains, _notes(entry), licence).encode()}
    if rains and (folder / rains[0] / STATISTICS).is_file():
        files[STATISTICS] = csv_bytes(summarise(folder, rains[0]))
    if licence:
        files[f"{LICENCE}/{STATED}"] = json_bytes(asdict(licence))
        if licence.text == "Apache-2.0":
            files[f"{LICENCE}/{APACHE}"] = APACHE_TEXT.read_bytes()
    return files


def _notes(entry: Mapping[str, Any]) -> list[str]:
    """What the capture's reader remarked, but for remarks that name a place on this machine."""
    return [note for note in entry.get("notes", ()) if not any(map(_is_place, note.split()))]


def _is_place(word: str) -> bool:
    path = word.strip("\"'(),.;:")
    return PurePosixPath(path).is_absolute() or PureWindowsPath(path).is_absolute()


def is_ours(folder: Path, name: str, rains: list[str], shareable: bool) -> bool:
    """Whether a file is the generator's and holds no picture of the capture.

    Drops show the scene, so that planes of added light are a picture made of the photograph, and go with its licence.
    """
    if name in (REQUEST, SPLIT, CARD, STATISTICS) or name.startswith(f"{LICENCE}/"):
        return True
    top, _, below = name.partition("/")
    if top not in rains:
        return False
    if below.startswith(f"{LAYERS}/"):
        return shareable or not light_stems(_planes(folder / top))
    return below in (PATTERN_FILE, STATISTICS, CAMERA_FILE)


def _planes(variant: Path) -> Mapping[str, Any]:
    return find_effect(read_json(variant / PATTERN_FILE)["effect"]).planes


def _refused(folder: Path, licence: Licence | None) -> InputError:
    return InputError(
        f"{folder}: the licence of its photographs does not allow to hand them on, as far as is known",
        found=f"{licence.text}, not shareable, as stated by {licence.said_by}" if licence else "no stated licence",
        expected='"licence": "CC-BY-4.0", "shareable": true in the capture\'s capture.json, and the build run again',
        fix='if the rights are yours, state the licence: --i-have-the-rights "CC-BY-4.0"; or add --layers-only, which '
        "packs what the generator made, for people who have the capture",
    )
