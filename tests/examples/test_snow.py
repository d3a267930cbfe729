"""The example of an effect of one's own is built, checked and described like any other, and is what it says."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from synthetic import written_capture

from hydroviews.dataset.card.contact_sheet import write_sheets
from hydroviews.dataset.checks.verify import verify
from hydroviews.dataset.sources import build_source
from hydroviews.dataset.variants import open_clean, open_variant
from hydroviews.profiles import find_profile
from hydroviews.scene.images import read_image
from hydroviews.torch import RainyViews

REPOSITORY = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Light and heavy snow on a small scene, built from the repository as the documentation says."""
    folder = tmp_path_factory.mktemp("snow")
    yard = written_capture(folder / "yard")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(REPOSITORY)
        patterns = ["examples.snow:Snow-0", "examples.snow:Snow-2"]
        yield build_source(str(yard), folder / "data", find_profile("demo"), patterns=patterns)


def test_it_is_built_and_verified_like_any_other(built):
    assert verify(built.parent, every_view=True) == []
    assert "flakes a picture" in (built / "README.md").read_text()
    assert all(read_image(path).std() > 0 for path in write_sheets(built))


def test_heavy_snow_covers_more_than_light_snow_and_lies_elsewhere_in_every_view(built):
    clean = [view.image() for view in open_clean(built).views]
    light, heavy = (
        np.array([view.image() for view in open_variant(built, f"examples.snow.Snow-{grade}").views]) - clean
        for grade in (0, 2)
    )
    assert heavy.mean() > 2 * light.mean() > 0
    one, other, *_ = light > 0.1
    assert one.any()
    assert np.corrcoef(one.ravel(), other.ravel())[0, 1] < 0.5


def test_its_flakes_count_as_cover(built):
    for item in RainyViews(built, "examples.snow.Snow-2"):
        np.testing.assert_allclose(item["cover"], item["layers"]["A"][None], atol=1e-6)
        assert item["cover"].max() > 0
    assert pd.read_csv(built / "examples.snow.Snow-2/statistics.csv").streaks.min() > 0
