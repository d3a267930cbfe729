"""Published captures by name: their folders on this machine, and where to download them."""

import os
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from hydroviews.errors import InputError

DATA = Path(__file__).with_name("captures.toml")
VARIABLE = "HYDROVIEWS_CAPTURES"
DEFAULT = Path("captures")
SOURCE = "a folder of captures: CAPTURES=DIR for make, --captures DIR, or $" + VARIABLE


@dataclass(frozen=True)
class Archive:
    """A file with all scenes of a collection."""

    name: str
    urls: tuple[str, ...]  # mirrors, tried in order
    gigabytes: float
    sha256: str | None = None  # None: not known; that of the first download is kept


@dataclass(frozen=True)
class Capture:
    """A published capture."""

    collection: str
    scene: str
    title: str  # of the collection
    page: str
    folders: tuple[str, ...]  # below the captures' folder, the first is where a download goes
    images: str  # folder of photographs that results are published for
    archive: Archive | None
    by_hand: str  # how to get it where there is no archive; else empty
    captured_rainy: bool

    @property
    def name(self) -> str:
        """For example `mipnerf360/garden`."""
        return f"{self.collection}/{self.scene}"

    @property
    def folder_name(self) -> str:
        """The built scene's name, which no other capture has: `mipnerf360_garden`."""
        return f"{self.collection}_{self.scene}"

    @property
    def spellings(self) -> frozenset[str]:
        """All names it is found by, in lower case: its name, its folders, and the scene alone."""
        return frozenset(name.lower() for name in (self.name, self.folder_name, *self.folders))


def captures_root(given: Path | None = None) -> Path:
    """The folder of captures: the given one, else $HYDROVIEWS_CAPTURES, else `captures`."""
    return given or Path(os.environ.get(VARIABLE) or DEFAULT)


@cache
def all_captures() -> tuple[Capture, ...]:
    """The catalogue, in its own order."""
    content = tomllib.loads(DATA.read_text(encoding="utf-8"))
    return tuple(capture for name, collection in content.items() for capture in _captures(name, collection))


def _captures(name: str, collection: Mapping[str, Any]) -> Iterator[Capture]:
    archive = collection.get("archive", {})
    for scene, facts in collection["scenes"].items():
        by_hand = facts.get("by_hand", collection.get("by_hand", ""))
        yield Capture(
            collection=name,
            scene=scene,
            title=collection["title"],
            page=collection["page"],
            folders=tuple(folder.format(scene=scene) for folder in collection["folders"]),
            images=facts["images"],
            archive=None if by_hand else Archive(**{**archive, "urls": tuple(archive["urls"])}),
            by_hand=by_hand,
            captured_rainy=collection.get("rain") == "captured",
        )


def find_captures(name: str) -> list[Capture]:
    """The captures of that name, in any of their spellings; else all of the collection of that name; else none."""
    wanted = name.rstrip("/").lower()
    found = [capture for capture in all_captures() if wanted in capture.spellings]
    return found or [capture for capture in all_captures() if wanted == capture.collection]


def locate(capture: Capture, root: Path) -> Path | None:
    """The capture's folder below `root`; None where none of its folders exists or all are empty."""
    found = (_child(root, folder) for folder in capture.folders)
    return next((folder for folder in found if folder is not None and any(folder.iterdir())), None)


def _child(root: Path, relative: str) -> Path | None:
    """The folder of that path below `root`, whatever its case."""
    folder = root
    for part in relative.split("/"):
        if (folder / part).is_dir():
            folder = folder / part
            continue
        same = [p for p in folder.iterdir() if p.name.lower() == part.lower()] if folder.is_dir() else []
        if not same or not same[0].is_dir():
            return None
        folder = same[0]
    return folder


class NoCapture(InputError):
    """No capture of that name or in that folder is on this machine."""


class MissingCapture(NoCapture):
    """A published capture is not on this machine; the error says how to get it."""

    def __init__(self, capture: Capture, root: Path):
        if capture.archive:
            get = (
                f"`hydroviews download {capture.name}` gets it ({capture.archive.name}, about "
                f"{capture.archive.gigabytes:g} GB, from {capture.archive.urls[0]}) into {root / capture.folders[0]}"
            )
        else:
            get = f"{capture.by_hand}; it belongs into {root / capture.folders[0]}. Page: {capture.page}"
        super().__init__(
            f"SCENE={capture.name}: {capture.title}: {capture.scene} is not on this machine",
            found=f"none of {', '.join(str(root / folder) for folder in capture.folders)}",
            expected=SOURCE,
            fix=get,
        )
