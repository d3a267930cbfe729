import shutil
from pathlib import Path

import numpy as np
import pytest
from synthetic import written_capture

from hydroviews.dataset.build import build
from hydroviews.formats.read import read_scene
from hydroviews.rain.patterns import Pattern
from hydroviews.scene.masks import mask_name, write_ignored


@pytest.fixture(scope="session")
def finished(tmp_path_factory) -> Path:
    """The folder of a capture that has a mask, `capture/yard`, and of its scene in streaks and a storm, `data/yard`."""
    folder = tmp_path_factory.mktemp("finished")
    capture = written_capture(folder / "capture" / "yard")
    write_ignored(capture / "masks" / mask_name("view-03.png"), np.eye(36, 48, dtype=bool))
    build(read_scene(capture), folder / "data", patterns=[Pattern("streak", 1), Pattern("storm", 1)])
    return folder


@pytest.fixture
def built(finished, tmp_path) -> Path:
    """A copy of the scene, `data/yard`, for the test to change; its capture is beside it."""
    for name in ("capture", "data"):
        shutil.copytree(finished / name, tmp_path / name, symlinks=True)
    return tmp_path / "data" / "yard"
