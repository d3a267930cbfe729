"""Published captures from the network into the captures' folder.

<captures>/downloads/360_v2.zip          the archive, kept for its other scenes
<captures>/downloads/360_v2.zip.sha256   its checksum: the catalogue's, or that of the first download
<captures>/360_v2/garden                 a scene, there once it is whole
"""

import os
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlparse

from hydroviews.captures.catalogue import Archive, Capture, MissingCapture, all_captures, find_captures, locate
from hydroviews.captures.download.archives import is_archive, unpack
from hydroviews.captures.download.http import digest, fetch
from hydroviews.errors import InputError, unknown_name
from hydroviews.files.atomic import BUSY, locked, write_bytes

FOLDER = "downloads"
SOURCE = "SOURCE.md"
VARIABLE = "HYDROVIEWS_MIRROR"
SUFFIXES = (".zip", ".tar", ".tgz", ".tar.gz", ".tar.bz2", ".tar.xz")


def download_captures(name: str, root: Path, mirror: str | None = None) -> Iterator[Path]:
    """Get a capture, or all of a collection; what is there already stays as it is.

    Args:
        name: of the capture or the collection.
        root: the captures' folder.
        mirror: an archive's address, or that of a folder with archives, tried before the catalogue's;
            $HYDROVIEWS_MIRROR if None.

    Yields:
        The captures' folders, each once it is whole.

    Raises:
        InputError: no such capture, one that has to be fetched by hand, or a download or an archive that fails.
    """
    captures = find_captures(name)
    if not captures:
        raise unknown_name(name, name, "capture to download", [capture.name for capture in all_captures()])
    checked: dict[Archive, str] = {}
    for capture in sorted(captures, key=lambda capture: capture.archive is None):  # what is for hands comes last
        yield locate(capture, root) or _get(capture, root, mirror, checked)


def _get(capture: Capture, root: Path, mirror: str | None, checked: dict[Archive, str]) -> Path:
    if capture.archive is None:
        raise MissingCapture(capture, root)
    path, folder = root / FOLDER / capture.archive.name, root / capture.folders[0]
    with locked(path, BUSY):
        if capture.archive not in checked:
            checked[capture.archive] = get_archive(capture.archive, path, mirror)
        if locate(capture, root) is None:
            unpack(path, capture.scene, folder, checked[capture.archive][:12])
    if not (folder / SOURCE).exists():
        write_bytes(folder / SOURCE, _origin(capture, capture.archive, checked[capture.archive]).encode())
    return folder


def _origin(capture: Capture, archive: Archive, sha256: str) -> str:
    """Where a capture comes from, in words that built scenes keep."""
    return (
        f"# {capture.scene}\n\n{capture.title}, {capture.page}\n\nUnpacked from {archive.name} "
        f"(SHA-256 {sha256}), published at {archive.urls[0]}. For its licence see its authors' page.\n"
    )


def get_archive(archive: Archive, path: Path, mirror: str | None = None) -> str:
    """Download an archive, or check the one that is there; returns its SHA-256.

    Where the catalogue has no checksum, that of the first download is written beside it and holds from then on.

    Raises:
        InputError: see `transfer.fetch`; the archive that is there has another checksum; a mirror that is none.
    """
    lock = path.with_name(path.name + ".sha256")
    expected = archive.sha256 or _read_lock(lock)
    if path.is_file():
        found = digest(path)
        if expected not in (None, found):
            raise InputError(
                f"{path}: wrong checksum",
                found=found,
                expected=f"{expected}, from {'the catalogue' if archive.sha256 else lock}",
                fix="delete it and download it again" + ("" if archive.sha256 else f"; if it is right, delete {lock}"),
            )
    else:
        size = f"about {archive.gigabytes:g} GB"
        print(f"{path}: {size}, kept for the other scenes in it; remove it when you need none", flush=True)
        found = fetch(addresses(archive, mirror), path, expected, _not_an_archive)
    if expected is None:
        write_bytes(lock, f"{found}  {path.name}\n".encode())
    return found


def addresses(archive: Archive, mirror: str | None = None) -> list[str]:
    """Where to look for an archive, in order.

    Raises:
        InputError: the mirror is not an address.
    """
    mirror = mirror or os.environ.get(VARIABLE)
    if not mirror:
        return list(archive.urls)
    parsed = urlparse(mirror)
    if parsed.scheme not in ("http", "https") or not parsed.netloc:
        raise InputError(
            f"--mirror {mirror}: not an address",
            expected="http://... or https://...",
            fix=f"for a copy on this machine, put {archive.name} into the captures' folder, under {FOLDER}",
        )
    whole = parsed.path.lower().endswith(SUFFIXES)
    return [mirror if whole else f"{mirror.rstrip('/')}/{archive.name}", *archive.urls]


def _read_lock(lock: Path) -> str | None:
    words = lock.read_text().split() if lock.is_file() else []
    return words[0] if words else None


def _not_an_archive(path: Path) -> str:
    return "" if is_archive(path) else "what arrived is no zip or tar archive (a page of text?)"
