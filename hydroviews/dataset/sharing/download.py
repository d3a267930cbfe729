"""The archive of an address, on disk as long as it is needed."""

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from hydroviews.captures.download.archives import is_archive
from hydroviews.dataset.sharing.archive import open_archive
from hydroviews.errors import InputError
from hydroviews.files.atomic import sha256
from hydroviews.files.http_download import fetch as download
from hydroviews.files.locks import BUSY, locked
from hydroviews.files.temporary import PARTIAL

CHECKSUM = "#sha256="
WEB = ("http://", "https://")


@contextmanager
def archive_on_disk(address: str, data: Path) -> Iterator[Path]:
    """The archive of an address or a file; one that was downloaded is removed once the block ends without an error.

    Args:
        address: see `fetch`.
        data: the data folder, in which downloads are hidden; a later call goes on with one that was interrupted.

    Raises:
        InputError: it cannot be had, or has another checksum than the address says.
    """
    place, _, expected = address.partition(CHECKSUM)
    expected = expected.strip().lower()
    if not place.startswith(WEB):
        if expected and Path(place).is_file() and (found := sha256(Path(place))) != expected:
            raise InputError(f"{place}: wrong checksum", found=found, expected=expected, fix="get the archive again")
        yield Path(place)
        return
    target = data / f"{PARTIAL}fetched-{hashlib.sha256(address.encode()).hexdigest()[:12]}.zip"
    with locked(target, BUSY):
        if not target.is_file():
            download(
                [place],
                target,
                expected or None,
                refuse=lambda path: "" if is_archive(path) else "what arrived is no archive (a page of text?)",
                known_from="as the address says",
                otherwise="Or get the archive in another way, and fetch the file",
            )
        try:
            yield target
        except InputError:
            _remove_if_damaged(target)
            raise
        target.unlink()


def _remove_if_damaged(target: Path) -> None:
    """Remove a download that no later call could use."""
    try:
        packed = open_archive(target)
        for name in packed.places:
            for _ in packed.blocks(name):
                pass
    except InputError:
        target.unlink()
