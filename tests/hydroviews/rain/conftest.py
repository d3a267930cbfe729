from dataclasses import replace

import numpy as np
import pytest
from synthetic import capture_in

from hydroviews.rain.scene_statistics import SceneStatistics, survey


@pytest.fixture(scope="session")
def statistics(tmp_path_factory) -> SceneStatistics:
    """Statistics of a ring of nine small views around some points, without depth maps; read only."""
    return survey(capture_in(tmp_path_factory.mktemp("capture") / "yard"), 0)


@pytest.fixture(scope="session")
def yard(statistics) -> SceneStatistics:
    """The ring, a metre a unit."""
    return replace(statistics, metres_per_unit=1.0)


@pytest.fixture(scope="session")
def waves() -> np.ndarray:
    """A colourful picture of 80x60, encoded."""
    y, x = np.mgrid[0:60, 0:80] / 80
    parts = [0.5 + 0.45 * np.sin(a * x + b * y + c) for a, b, c in ((9, 4, 0), (3, 11, 1), (14, -8, 2))]
    return np.stack(parts, -1).astype(np.float32)
