"""Files over HTTP: from the first of several servers, going on where an earlier transfer ended, checked at the end."""

import hashlib
import http.client
import os
import shutil
import ssl
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from tqdm import tqdm

import hydroviews
from hydroviews.errors import InputError
from hydroviews.files.atomic import read_json, write_json
from hydroviews.files.full_disk import plain_full_disk

BLOCK = 1 << 20  # bytes
TIMEOUT = 30.0  # seconds without a byte
ATTEMPTS = 4  # at one server without a byte more each time
PAUSE = 1.0  # seconds before the second attempt, doubled before each later one
RETRIED = (408, 425, 429, 500, 502, 503, 504)  # answers that may be others a little later
NETWORK = (urllib.error.URLError, http.client.HTTPException, TimeoutError, ConnectionError, ssl.SSLError)


class Refused(Exception):
    """A server that does not deliver the file, and why."""


class Cut(Exception):
    """A transfer that ended early; what has arrived is kept."""


@dataclass(frozen=True)
class Begun:
    """What is known of a file of which a part is here."""

    url: str
    size: int | None  # bytes in all, where the server said so
    tag: str | None  # the server's mark of this version: a strong ETag, or the date of change


def fetch(
    urls: Sequence[str], target: Path, sha256: str | None = None, refuse: Callable[[Path], str] = lambda path: ""
) -> str:
    """Download a file, whole or not at all under its name.

    What has arrived stays in `<target>.part` and is gone on with if the server still has the same file. Bytes from
    two servers are only joined where a checksum tells whether they fit.

    Args:
        urls: where the file is, tried in order.
        target: the file.
        sha256: what it must have; None if that is not known.
        refuse: says what is wrong with a file that arrived whole, "" if nothing is.

    Returns:
        Its SHA-256.

    Raises:
        InputError: no server delivers it, or the disk is full; what to do is told.
    """
    reasons = []
    for url in urls:
        try:
            return _fetch_from(url, target, sha256, refuse)
        except Refused as reason:
            reasons.append(f"{url}: {reason}")
    raise InputError(
        f"{target.name}: no server delivers it",
        found="\n    ".join(["", *reasons]),
        fix="check the network and run the same command again: what has arrived is kept. Or name another server "
        f"(--mirror URL), or put the file there by hand: {target}",
    )


def _fetch_from(url: str, target: Path, sha256: str | None, refuse: Callable[[Path], str]) -> str:
    part, about = _part(target), _about(target)
    with plain_full_disk(part):
        part.parent.mkdir(parents=True, exist_ok=True)
        _transfer_patiently(url, target, joinable=sha256 is not None)
        found = digest(part)
        wrong = f"wrong checksum {found}, expected {sha256}" if sha256 not in (None, found) else refuse(part)
        if wrong:
            part.unlink()
            about.unlink(missing_ok=True)
            raise Refused(wrong)
        os.replace(part, target)
        about.unlink(missing_ok=True)
    return found


def _part(target: Path) -> Path:
    return target.with_name(target.name + ".part")


def _about(target: Path) -> Path:
    return target.with_name(target.name + ".part.json")


def digest(path: Path) -> str:
    """SHA-256 of a file's bytes in hexadecimal, with progress for large ones."""
    state, size = hashlib.sha256(), path.stat().st_size
    with (
        path.open("rb") as file,
        tqdm(total=size, desc=f"checksum of {path.name}", unit="B", unit_scale=True, leave=False, delay=2) as bar,
    ):
        while block := file.read(BLOCK):
            state.update(block)
            bar.update(len(block))
    return state.hexdigest()


def _transfer_patiently(url: str, target: Path, joinable: bool) -> None:
    """Transfer the file to its part; a connection that breaks is taken up again as long as bytes come."""
    failures = 0
    while True:
        before = _size(_part(target))
        try:
            _transfer(url, target, joinable)
            return
        except Cut as cut:
            failures = 1 if _size(_part(target)) > before else failures + 1
            if failures >= ATTEMPTS:
                raise Refused(str(cut)) from None
            time.sleep(PAUSE * 2 ** (failures - 1))


def _size(path: Path) -> int:
    return path.stat().st_size if path.is_file() else 0


def _transfer(url: str, target: Path, joinable: bool) -> None:
    """One connection: all that is missing, or as much as comes.

    Raises:
        Cut: it ended early.
        Refused: the server does not have the file.
    """
    known = _read_begun(target)
    same = known is not None and known.url == url and (known.tag or known.size) is not None
    have = _size(_part(target)) if known and (same or joinable) else 0
    if known and have and have == known.size:
        return
    try:
        with _open(url, have, known) as response:
            start = have if response.status == http.client.PARTIAL_CONTENT else 0
            total = _total(response, start, have)
            if start and known and None not in (total, known.size) and total != known.size:
                _part(target).unlink()  # another file by now
                raise Cut("the file changed on the server")
            _refuse_if_too_large(target, total, start)
            if not start:
                _part(target).unlink(missing_ok=True)  # before it is said to be a part of this file
            write_json(_about(target), asdict(Begun(url, total, _tag(response))))
            _receive(response, target, start, total)
    except urllib.error.HTTPError as error:
        if error.code == http.client.REQUESTED_RANGE_NOT_SATISFIABLE:
            _part(target).unlink(missing_ok=True)
            raise Cut("the part that is here does not fit the server's file") from None
        answer = f"the server answered {error.code} {error.reason}"
        raise (Cut(answer) if error.code in RETRIED else Refused(answer)) from None
    except NETWORK as error:
        raise Cut(f"no connection ({getattr(error, 'reason', None) or error})") from None


def _read_begun(target: Path) -> Begun | None:
    try:
        return Begun(**read_json(_about(target)))
    except (InputError, TypeError):
        return None


def _open(url: str, have: int, known: Begun | None) -> http.client.HTTPResponse:
    headers = {"User-Agent": f"hydroviews/{hydroviews.__version__}", "Accept-Encoding": "identity"}
    if have:
        headers["Range"] = f"bytes={have}-"
        if known and known.tag and known.url == url:
            headers["If-Range"] = known.tag
    response: http.client.HTTPResponse = urllib.request.urlopen(
        urllib.request.Request(url, headers=headers), timeout=TIMEOUT
    )
    return response


def _total(response: http.client.HTTPResponse, start: int, asked: int) -> int | None:
    """Bytes of the whole file, where the server says."""
    if response.status == http.client.PARTIAL_CONTENT:
        unit, _, rest = response.headers.get("Content-Range", "").partition(" ")
        first, total = rest.partition("-")[0], rest.rpartition("/")[2]
        if unit != "bytes" or first != str(asked):
            raise Refused(f"the server sent another range than asked for: {response.headers.get('Content-Range')}")
        return int(total) if total.isdecimal() else None
    length = response.headers.get("Content-Length", "")
    return start + int(length) if length.isdecimal() else None


def _tag(response: http.client.HTTPResponse) -> str | None:
    tag = response.headers.get("ETag")
    return tag if tag and not tag.startswith("W/") else response.headers.get("Last-Modified")


def _refuse_if_too_large(target: Path, total: int | None, start: int) -> None:
    free = shutil.disk_usage(target.parent).free
    if total is not None and total - start > free:
        raise InputError(
            f"{target}: no space left on the disk",
            found=f"{free / 1e9:.1f} GB free",
            expected=f"{(total - start) / 1e9:.1f} GB",
            fix="free some space, or choose another folder (--captures DIR), and run the same command again",
        )


def _receive(response: http.client.HTTPResponse, target: Path, start: int, total: int | None) -> None:
    have = start
    with (
        _part(target).open("ab" if start else "wb") as file,
        tqdm(total=total, initial=start, desc=target.name, unit="B", unit_scale=True) as bar,
    ):
        while block := response.read(BLOCK):
            file.write(block)
            bar.update(len(block))
            have += len(block)
    if total is not None and have != total:
        raise Cut(f"the connection ended after {have} of {total} bytes")
