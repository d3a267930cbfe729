"""Files of Python packages, fetched from the index that pip is configured for without running anything of theirs.

`pip download` builds the metadata of a source package, which executes its setup.py. Here the index's list of files is
read (the simple repository API, PEP 503) and the file is fetched and checked as any other download.
"""

import ast
import http.client
import subprocess
import sys
import urllib.request
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urldefrag, urljoin, urlsplit

from hydroviews.errors import InputError
from hydroviews.files import http_download

PYPI = "https://pypi.org/simple"
TIMEOUT = 30.0  # seconds without a byte


def fetch_archive(package: str, archive: str, sha256: str, folder: Path) -> Path:
    """Fetch one file of a package into a folder.

    Args:
        package: its name, normalised as in PEP 503.
        archive: the file's name.
        sha256: what it must have, in hexadecimal.
        folder: where it goes.

    Raises:
        InputError: no index has it, none can be reached, or the file is another one.
    """
    urls, reasons = [], []
    for index in pip_indexes():
        try:
            urls += [url for url in list_files(index, package) if unquote(urlsplit(url).path).endswith(f"/{archive}")]
        except (OSError, ValueError, http.client.HTTPException) as error:
            reasons.append(f"{http_download.without_password(index)}: {error}")
    if not urls:
        raise InputError(f"{archive}: no package index has it", found="; ".join(reasons) or "another list of files")
    http_download.fetch(urls, folder / archive, sha256)
    return folder / archive


def pip_indexes() -> list[str]:
    """Addresses of the indexes that pip would look in, by its settings and environment; none with `no-index`."""
    listed = subprocess.run([sys.executable, "-m", "pip", "config", "list"], capture_output=True, text=True).stdout
    pairs = (line.partition("=") for line in listed.splitlines() if "=" in line)
    settings = {key: ast.literal_eval(value) for key, _, value in pairs}

    def setting(name: str) -> str:
        found = (settings.get(f"{section}.{name}") for section in (":env:", "download", "global"))
        return next((value for value in found if value), "")

    if setting("no-index").lower() in ("1", "true", "yes", "on"):
        return []
    return [setting("index-url") or PYPI, *setting("extra-index-url").split()]


def list_files(index: str, package: str) -> list[str]:
    """Addresses of a package's files in an index; on its own host, with the name and password that `index` has.

    Raises:
        OSError: the index cannot be reached, or does not have the package.
        ValueError, http.client.HTTPException: not an address, or an answer that is not HTTP.
    """
    page = f"{index.rstrip('/')}/{package}/"
    page += "index.html" if page.startswith("file:") else ""
    request = http_download.request_for(page, {"Accept": "text/html"})
    with urllib.request.urlopen(request, timeout=TIMEOUT) as response:
        links = _Links()
        links.feed(response.read().decode("utf-8"))
        return [_logged_in(urldefrag(urljoin(response.url, link)).url, index) for link in links.found]


def _logged_in(url: str, index: str) -> str:
    """The address with the name and password of the index, if it is on the same host."""
    parts, own = urlsplit(url), urlsplit(index)
    same = (parts.scheme, parts.netloc) == (own.scheme, own.netloc.rpartition("@")[2])
    return parts._replace(netloc=own.netloc).geturl() if same else url


class _Links(HTMLParser):
    """Collects where a page's links lead."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found += [value for name, value in attrs if tag == "a" and name == "href" and value]
