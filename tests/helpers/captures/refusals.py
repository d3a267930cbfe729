"""Captures that are refused."""

from pathlib import Path

import pytest

from hydroviews.errors import InputError
from hydroviews.formats.read import read_scene


def assert_refused(folder: Path, match: str) -> None:
    """Reading the capture ends in an error with such a message."""
    with pytest.raises(InputError, match=match):
        read_scene(folder)
