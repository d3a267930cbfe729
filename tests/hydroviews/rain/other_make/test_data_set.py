import numpy as np
import pytest
from synthetic import capture_in

from hydroviews.dataset.build import build
from hydroviews.dataset.card.contact_sheet import write_sheets
from hydroviews.dataset.checks.verify import verify
from hydroviews.dataset.statistics import read_statistics
from hydroviews.rain.layers import read_layers
from hydroviews.rain.patterns import Pattern
from hydroviews.rain.registry import choose_patterns, find_effect
from hydroviews.scene.images import read_image

PATTERNS = (Pattern("raindrop-b", 1), Pattern("streak-b", 1))


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    folder = tmp_path_factory.mktemp("built")
    return build(capture_in(folder / "capture" / "yard"), folder / "data", patterns=PATTERNS)


def test_a_data_set_is_built_verified_described_and_shown(built):
    assert verify(built.parent, every_view=True) == []
    drops, streaks = (read_statistics(built / pattern.name / "statistics.csv") for pattern in PATTERNS)
    assert (drops[["water", "mist"]] > 0).all(axis=None)
    assert drops["streaks"].isna().all()
    assert (streaks["streaks"] > 0).all()
    assert streaks["angle"].notna().all()
    assert len(write_sheets(built, columns=2)) == 2
    card = (built / "README.md").read_text()
    assert "key frames" in card
    assert "strokes a picture" in card


@pytest.mark.parametrize("pattern", PATTERNS)
def test_masks_of_drops_and_streaks_are_the_planes_that_share_names(built, pattern):
    effect = find_effect(pattern.effect)
    covers = [name for name, plane in effect.planes.items() if plane.share]
    assert {effect.planes[name].share for name in covers} & {"water", "streaks"}
    layers = read_layers(built / pattern.name / "layers" / "view-03.exr")
    rainy, clean = (read_image(built / part / "view-03.png") for part in (f"{pattern.name}/images", "clean"))
    dry = np.all([layers[name] == 0 for name in covers], axis=0)
    assert np.abs(rainy - clean).max() > 0.05
    np.testing.assert_array_equal(rainy[dry], clean[dry])


def test_neither_is_a_default():
    assert {pattern.effect for pattern in choose_patterns((), (0, 1, 2))} == {"raindrop", "streak"}
