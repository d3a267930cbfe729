"""Where tests find real captures: $HYDROVIEWS_CAPTURES, or ../shared/data beside the checkout."""

import os
from pathlib import Path

import pytest

ROOT = Path(os.environ.get("HYDROVIEWS_CAPTURES") or Path(__file__).parents[3] / "shared" / "data")


def capture(name: str) -> Path:
    """The folder of a real capture; skips the test where it is missing."""
    folder = ROOT / name
    if not folder.is_dir():
        pytest.skip(f"real capture {name} is not in {ROOT}; set HYDROVIEWS_CAPTURES to a folder that holds it")
    return folder
