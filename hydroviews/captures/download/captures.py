"""Download published captures into the captures' folder.

<captures>/downloads/360_v2.zip          the archive, kept for its other scenes
<captures>/downloads/360_v2.zip.sha256   its checksum: the catalogue's, or that of the first download
<captures>/360_v2/garden                 a scene, there once it is whole
"""

import logging
import os
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlparse

from hydroviews.captures.catalogue.catalogue import (
    Archive,
    Capture,
    MissingCapture,
    all_captures,
    find_captures,
    locate,
)
from hydroviews.captures.download.archives import BadArchive, is_archive, unpack
from hydroviews.errors import InputError, unknown_name
from hydroviews.files import ownership
from hydroviews.files.atomic import write_bytes
from hydroviews.files.http_download import digest, fetch
from hydroviews.files.locks import BUSY, locked

logger = logging.getLogger(__name__)

FOLDER = "downloads"
SOURCE = "SOURCE.md"
VARIABLE = "HYDROVIEWS_MIRROR"
SUFFIXES = (".zip", ".tar", ".tgz", ".tar.gz", ".tar.bz2", ".tar.xz")


def download_captures(name: str, root: Path, mirror: str | None = None) -> Iterator[Path]:
    """Download a capture, or all of a collection; captures already on disk stay as they are.

    Args:
        name: of the capture or the collection.
        root: the captures' folder.
        mirror: address of an archive, or of a folder of archives, tried before the catalogue's;
            $HYDROVIEWS_MIRROR if None.

    Yields:
        The captures' folders, each once it is complete.

    Raises:
        InputError: there is no such capture, it has to be fetched by hand, its download fails, or its archive is
            damaged.
    """
    captures = find_captures(name)
    if not captures:
        raise unknown_name(name, name, "capture to download", [capture.name for capture in all_captures()])
    checked: dict[Archive, str] = {}
    for capture in sorted(captures, key=lambda capture: capture.archive is None):  # None raises: last
        yield locate(capture, root) or _get(capture, root, mirror, checked)


def _get(capture: Capture, root: Path, mirror: str | None, checked: dict[Archive, str]) -> Path:
    if capture.archive is None:
        raise MissingCapture(capture, root)
    path, folder = root / FOLDER / capture.archive.name, root / capture.folders[0]
    with locked(path, BUSY):
        if capture.archive not in checked:
            checked[capture.archive] = get_archive(capture.archive, path, mirror)
        if locate(capture, root) is None:
            try:
                unpack(path, capture.scene, folder, checked[capture.archive][:12])
            except BadArchive:
                ownership.remove(_lock(path))  # the next download is not to be as bad as this one
                raise
    if not (folder / SOURCE).exists():
        write_bytes(folder / SOURCE, _origin(capture, capture.archive, checked[capture.archive]).encode())
    return folder


def _origin(capture: Capture, archive: Archive, sha256: str) -> str:
    """The text of SOURCE.md, which built scenes copy: where a capture comes from."""
    return (
        f"# {capture.scene}\n\n{capture.title}, {capture.page}\n\nUnpacked from {archive.name} "
        f"(SHA-256 {sha256}), published at {archive.urls[0]}. For its licence see its authors' page.\n"
    )


def get_archive(archive: Archive, path: Path, mirror: str | None = None) -> str:
    """Download an archive, or check the one on disk; returns its SHA-256.

    Where the catalogue has no checksum, that of the first download is written beside the archive and required later,
    until the archive turns out to be bad.

    Raises:
        InputError: see `http_download.fetch`; the archive on disk has another checksum; the mirror is not an address.
    """
    lock = _lock(path)
    expected = archive.sha256 or _read_lock(lock)
    if path.is_file():
        found = digest(path)
        if expected not in (None, found):
            raise InputError(
                f"{path}: wrong checksum",
                found=found,
                expected=f"{expected}, {_origin_of(archive, lock)}",
                fix="delete it and download it again",
            )
    else:
        size = f"about {archive.gigabytes:g} GB"
        logger.info("%s: %s, kept for the other scenes in it; remove it when you need none", path, size)
        found = fetch(addresses(archive, mirror), path, expected, _not_an_archive, _origin_of(archive, lock))
    if expected is None:
        write_bytes(lock, f"{found}  {path.name}\n".encode())
    return found


def addresses(archive: Archive, mirror: str | None = None) -> list[str]:
    """The addresses of an archive in the order to try.

    Raises:
        InputError: the mirror is not an address.
    """
    mirror = mirror or os.environ.get(VARIABLE)
    if not mirror:
        return list(archive.urls)
    try:
        parsed = urlparse(mirror)
    except ValueError:  # a bracket that is not closed
        parsed = urlparse("")
    if parsed.scheme not in ("http", "https") or not parsed.netloc:
        raise InputError(
            f"--mirror {mirror}: not an address",
            expected="http://... or https://...",
            fix=f"for a copy on this machine, put {archive.name} into the captures' folder, under {FOLDER}",
        )
    whole = parsed.path.lower().endswith(SUFFIXES)
    return [mirror if whole else f"{mirror.rstrip('/')}/{archive.name}", *archive.urls]


def _lock(path: Path) -> Path:
    """The file with the checksum of an archive."""
    return path.with_name(path.name + ".sha256")


def _origin_of(archive: Archive, lock: Path) -> str:
    """Where the expected checksum is from, for errors."""
    return "from the catalogue" if archive.sha256 else f"from {lock}: delete that if another archive is right"


def _read_lock(lock: Path) -> str | None:
    words = lock.read_text().split() if lock.is_file() else []
    return words[0] if words else None


def _not_an_archive(path: Path) -> str:
    return "" if is_archive(path) else "what arrived is no zip or tar archive (a page of text?)"
