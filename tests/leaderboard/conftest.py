"""Methods made for tests."""

import sys
from pathlib import Path

import pytest

from leaderboard import evaluate, tables


@pytest.fixture
def toys(monkeypatch):
    """The toy methods importable here and in the processes started, and as reference rows."""
    folder = str(Path(__file__).parent)
    monkeypatch.setenv("PYTHONPATH", folder)
    monkeypatch.syspath_prepend(folder)
    for module in (evaluate, tables):
        monkeypatch.setattr(module, "CEILING", "toy_methods:MeanColourClean")
        monkeypatch.setattr(module, "FLOOR", "toy_methods:MeanColour")
    yield
    sys.modules.pop("toy_methods", None)
