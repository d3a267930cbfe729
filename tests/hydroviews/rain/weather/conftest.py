from dataclasses import replace

import numpy as np
import pytest
from synthetic import capture_in

from hydroviews.rain.scene_statistics import SceneStatistics, survey
from hydroviews.scene.cameras import Camera
from hydroviews.scene.scenes import View


@pytest.fixture
def yard(tmp_path) -> SceneStatistics:
    """A ring of nine small views around some points, a metre a unit, without depth maps."""
    return replace(survey(capture_in(tmp_path / "yard"), 0), metres_per_unit=1.0)


@pytest.fixture
def ahead(tmp_path) -> View:
    """A view along +z from the origin; no picture is there."""
    return View("ahead", Camera(40, 30, 36.0, 36.0, 20.0, 15.0, np.eye(4)), tmp_path / "images" / "ahead.png")
