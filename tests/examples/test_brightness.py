"""The example of a metric of one's own: registered like one of another package, it is in a run's scores."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from finished_runs import finished_run

from examples.brightness import brightness_error
from hydroviews.metrics import find_metrics
from leaderboard.scoring.score import score

REPOSITORY = Path(__file__).parents[2]


@pytest.fixture
def registered(tmp_path, monkeypatch):
    """What an installed package with the entry point of the tutorial leaves."""
    package = tmp_path / "site" / "mine-1.dist-info"
    package.mkdir(parents=True)
    (package / "METADATA").write_text("Metadata-Version: 2.1\nName: mine\nVersion: 1\n")
    (package / "entry_points.txt").write_text("[hydroviews.metrics]\nbrightness = examples.brightness:BRIGHTNESS\n")
    monkeypatch.syspath_prepend(str(package.parent))
    find_metrics.cache_clear()
    yield
    find_metrics.cache_clear()


def test_it_is_the_distance_of_the_means_of_what_is_shown():
    target = np.full((4, 6, 3), 0.5, np.float32)
    image = target.copy()
    image[:, :3] += np.float32(10 / 255)
    assert brightness_error(image, target) == pytest.approx(5, abs=1e-4)
    ignored = np.zeros((4, 6), bool)
    ignored[:, 3:] = True
    assert brightness_error(image, target, ignored=ignored) == pytest.approx(10, abs=1e-4)


@pytest.mark.usefixtures("registered")
def test_a_record_has_it_beside_psnr(tmp_path):
    run = finished_run(tmp_path)
    record = score(run)
    views = pd.read_csv(run.folder / "per_view.csv")
    assert record.scores["brightness"] == pytest.approx(views.brightness.mean(), abs=1e-5)
    assert record.scores["brightness"] > 0
    assert record.scores["psnr"] > 0
