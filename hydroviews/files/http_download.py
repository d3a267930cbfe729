"""Download files over HTTP: mirrors in order, resumed after an interruption, checked by SHA-256.

Written on urllib: requests and urllib3 repeat whole requests, but neither continues the body of an interrupted one, and
pooch restarts a download from its beginning; archives here have up to 12 GB.
"""

import base64
import hashlib
import http.client
import os
import re
import shutil
import ssl
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from urllib.parse import unquote, urlsplit

from tqdm import tqdm

import hydroviews
from hydroviews.errors import InputError
from hydroviews.files import ownership
from hydroviews.files.atomic import read_json, write_json
from hydroviews.files.full_disk import plain_write_errors

BLOCK = 1 << 20  # bytes
TIMEOUT = 30.0  # seconds without data
ATTEMPTS = 4  # at one server in a row, each without new data
PAUSE = 1.0  # seconds before the second attempt, doubled before each later one
RETRIED = (408, 425, 429, 500, 502, 503, 504)  # HTTP statuses that may pass
SHOWN = 60  # characters of what a server says that are told
NETWORK = (urllib.error.URLError, http.client.HTTPException, TimeoutError, ConnectionError, ssl.SSLError)


class Refused(Exception):
    """A server does not deliver the file; the text says why."""


class ConnectionEnded(Exception):
    """A connection ended early; what has arrived is kept."""


@dataclass(frozen=True)
class PartialDownload:
    """A download of which a part is on disk."""

    url: str  # without password
    size: int | None  # bytes of the whole file; None where the server did not say
    tag: str | None  # the server's version of the file: a strong ETag, or Last-Modified


def fetch(
    urls: Sequence[str],
    target: Path,
    sha256: str | None = None,
    refuse: Callable[[Path], str] = lambda path: "",
    known_from: str = "as published",
    otherwise: str = "Or name another server (--mirror URL), or put the file there by hand: {target}",
) -> str:
    """Download a file; `target` exists only once the download is complete and checked.

    What has arrived is kept in `<target>.part`, and a later call resumes if the server still has the same file. Bytes
    of two servers are joined only where a checksum tells whether they fit.

    Args:
        urls: addresses of the file, tried in order; one may have a name and password: see `request_for`.
        target: where to write it.
        sha256: the expected hash in hexadecimal; None if it is not known.
        refuse: what is wrong with a complete file, "" if nothing is.
        known_from: where the expected hash is from, for the error.
        otherwise: what else the user may do where no server delivers it; `{target}` is where the file goes.

    Returns:
        Its SHA-256 in hexadecimal.

    Raises:
        InputError: no server delivers it, the disk is full, or the folder may not be written.
    """
    reasons = []
    for url in urls:
        try:
            return _fetch_from(url, target, sha256, refuse, known_from)
        except Refused as reason:
            reasons.append(f"{without_password(url)}: {reason}")
    raise InputError(
        f"{target.name}: no server delivers it",
        found="\n    ".join(["", *reasons]),
        fix="check the network and run the same command again: what has arrived is kept. "
        + otherwise.format(target=target),
    )


def _fetch_from(url: str, target: Path, sha256: str | None, refuse: Callable[[Path], str], known_from: str) -> str:
    part, record = _part(target), _record_path(target)
    with plain_write_errors(part):
        part.parent.mkdir(parents=True, exist_ok=True)
        _download_part(url, target, joinable=sha256 is not None)
        found = digest(part)
        other = sha256 not in (None, found)
        wrong = f"wrong checksum {found}, expected {sha256}, {known_from}" if other else refuse(part)
        if wrong:
            part.unlink()
            record.unlink(missing_ok=True)
            raise Refused(wrong)
        ownership.enter(target, part)
        os.replace(part, target)
        record.unlink(missing_ok=True)
    return found


def _part(target: Path) -> Path:
    return target.with_name(target.name + ".part")


def _record_path(target: Path) -> Path:
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


def _download_part(url: str, target: Path, joinable: bool) -> None:
    """Download to the part, connecting again after an interruption as long as data arrive."""
    failures = 0
    while True:
        before = _size(_part(target))
        try:
            _connect_once(url, target, joinable)
            return
        except ConnectionEnded as ended:
            failures = 1 if _size(_part(target)) > before else failures + 1
            if failures >= ATTEMPTS:
                raise Refused(str(ended)) from None
            time.sleep(PAUSE * 2 ** (failures - 1))


def _size(path: Path) -> int:
    return path.stat().st_size if path.is_file() else 0


def _connect_once(url: str, target: Path, joinable: bool) -> None:
    """Append what is missing to the part over one connection.

    Raises:
        ConnectionEnded: the connection ended early.
        Refused: the server does not have the file.
    """
    known = _read_record(target)
    shown = without_password(url)
    same = known is not None and known.url == shown and (known.tag or known.size) is not None
    have = _size(_part(target)) if known and (same or joinable) else 0
    if known and have and have == known.size:
        return
    try:
        with _open(url, have, known) as response:
            start = have if response.status == http.client.PARTIAL_CONTENT else 0
            total = _total(response, start, have)
            if start and known and None not in (total, known.size) and total != known.size:
                _part(target).unlink()  # another file by now
                raise ConnectionEnded("the file changed on the server")
            _refuse_if_too_large(target, total, start)
            if not start:
                _give_way(_part(target), known)  # before it is recorded as a part of this file
            write_json(_record_path(target), asdict(PartialDownload(shown, total, _tag(response))))
            _receive(response, target, start, total)
    except urllib.error.HTTPError as error:
        if error.code == http.client.REQUESTED_RANGE_NOT_SATISFIABLE:
            _part(target).unlink(missing_ok=True)
            raise ConnectionEnded("the part that is here does not fit the server's file") from None
        answer = f"the server answered {error.code} {str(error.reason)[:SHOWN]}"
        raise (ConnectionEnded(answer) if error.code in RETRIED else Refused(answer)) from None
    except NETWORK as error:
        raise ConnectionEnded(_failure(error)) from None


def _give_way(part: Path, known: PartialDownload | None) -> None:
    """Remove a part that nothing can be appended to; without a record it is another program's, and is set aside."""
    if known is None and part.exists():
        ownership.set_aside(part)
    part.unlink(missing_ok=True)


def _failure(error: Exception) -> str:
    """What went wrong with a connection; of an answer that is not HTTP, no more than its beginning."""
    if isinstance(error, http.client.BadStatusLine) and not isinstance(error, http.client.RemoteDisconnected):
        return f"the answer is not HTTP (it begins with {str(error)[:SHOWN]!a})"
    return f"no connection ({getattr(error, 'reason', None) or error})"


def _read_record(target: Path) -> PartialDownload | None:
    try:
        return PartialDownload(**read_json(_record_path(target)))
    except (InputError, TypeError):
        return None


def _open(url: str, have: int, known: PartialDownload | None) -> http.client.HTTPResponse:
    headers = {"User-Agent": f"hydroviews/{hydroviews.__version__}", "Accept-Encoding": "identity"}
    if have:
        headers["Range"] = f"bytes={have}-"
        if known and known.tag and known.url == without_password(url):
            headers["If-Range"] = known.tag
    try:
        response: http.client.HTTPResponse = urllib.request.urlopen(request_for(url, headers), timeout=TIMEOUT)
    except (ValueError, OverflowError) as error:  # no host name, no port: this address, or one that it leads to
        raise Refused(f"not an address to download from ({error})") from None
    return response


def request_for(url: str, headers: Mapping[str, str]) -> urllib.request.Request:
    """A request whose name and password, if `url` has any (https://name:password@host/), are sent as Basic auth.

    They go to that host alone, not to where it leads.

    Raises:
        ValueError: not an address.
    """
    parts = urlsplit(url)
    try:
        _ = parts.port
    except ValueError:  # what stands there may be a part of the password
        raise ValueError("its port is no number; write what is odd in a password as %XX") from None
    request = urllib.request.Request(parts._replace(netloc=parts.netloc.rpartition("@")[2]).geturl(), headers=headers)
    if parts.username:
        login = f"{unquote(parts.username)}:{unquote(parts.password or '')}"
        request.add_unredirected_header("Authorization", f"Basic {base64.b64encode(login.encode()).decode()}")
    return request


def without_password(url: str) -> str:
    """The address to show or to keep: without what stands before its last @, odd as it may be."""
    return re.sub(r"//.*@", "//", url)


def _total(response: http.client.HTTPResponse, start: int, asked: int) -> int | None:
    """Bytes of the whole file; None where the server does not say."""
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
        raise ConnectionEnded(f"the connection ended after {have} of {total} bytes")
