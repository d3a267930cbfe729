import numpy as np
import pytest

from hydroviews.scene.cameras import Camera
from hydroviews.scene.scenes import View


@pytest.fixture
def ahead(tmp_path) -> View:
    """A view along +z from the origin; no picture is there."""
    return View("ahead", Camera(40, 30, 36.0, 36.0, 20.0, 15.0, np.eye(4)), tmp_path / "images" / "ahead.png")
