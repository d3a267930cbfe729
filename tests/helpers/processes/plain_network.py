"""Downloads that try again at once, and no proxy: the servers are on this machine."""

import pytest

from hydroviews.files import http_download


@pytest.fixture
def plain_network(monkeypatch):
    """Neither pauses nor proxies."""
    monkeypatch.setattr(http_download, "PAUSE", 0.0)
    for name in ("http_proxy", "HTTP_PROXY"):
        monkeypatch.delenv(name, raising=False)
