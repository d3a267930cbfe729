from dataclasses import replace
from pathlib import Path

import pytest
from built_yard import built_yard
from synthetic import capture_in

from hydroviews.dataset.card.card import Licence, find_licence, keep_licence
from hydroviews.dataset.checks.verify import verify
from hydroviews.dataset.manifest import built_scenes
from hydroviews.dataset.statistics import read_statistics
from hydroviews.errors import InputError
from hydroviews.files.atomic import write_json


@pytest.fixture
def built(tmp_path) -> Path:
    return built_yard(tmp_path)


@pytest.mark.parametrize("photographs", ["images", "images/cam0", "frames", "rainy", "Images"])
def test_a_capture_states_its_licence_wherever_its_photographs_lie(tmp_path, photographs):
    scene = capture_in(tmp_path / "made", n_views=3)
    folder = tmp_path / "yard" / photographs
    folder.parent.mkdir(parents=True)
    (tmp_path / "made" / "images").rename(folder)
    scene = replace(scene, views=tuple(replace(view, path=folder / view.path.name) for view in scene.views))
    write_json(tmp_path / "yard" / "transforms.json", {})
    write_json(tmp_path / "yard" / "capture.json", {"licence": "CC-BY-4.0", "shareable": True})
    (tmp_path / "yard" / "LICENSE.txt").write_text("By Ada")
    (folder / "SOURCE.md").write_text("From a garden")
    (tmp_path / "LICENSE.other").write_text("Of another thing")
    keep_licence(scene, tmp_path / "built")
    assert find_licence(tmp_path / "built") == Licence("CC-BY-4.0", True, "the capture")
    kept = {path.name for path in (tmp_path / "built" / "licence").glob("[!.]*")}
    assert kept == {"LICENSE.txt", "SOURCE.md", "licence.json"}


def test_a_licence_that_is_stated_after_the_build_is_kept(built, tmp_path):
    write_json(tmp_path / "capture" / "yard" / "capture.json", {"licence": "CC0-1.0", "shareable": True})
    built_yard(tmp_path)
    assert find_licence(built) == Licence("CC0-1.0", True, "the capture")
    assert "as stated by the capture: CC0-1.0" in (built / "README.md").read_text()
    assert verify(built.parent) == []


def test_the_card_says_what_the_files_say(built):
    card = (built / "README.md").read_text()
    assert card.startswith("# yard\n")
    assert "| views | 9 of 48x36 pixels |" in card
    assert "| split | 7 to train on, 2 held out |" in card
    assert "sparse-views, with 3 of the training views" in card
    table = read_statistics(built / "statistics.csv").set_index("pattern")
    for name, grade in (("streak-0", "light"), ("streak-2", "heavy")):
        assert f"| {name} | {grade} | {table.loc[name].psnr_mean:.1f} dB (" in card
        assert f"* **{name}**: noise level n = " in card
    assert "> Licence: CC-BY" in card
    assert (built / "licence" / "SOURCE.md").read_text() == "# From a garden\nLicence: CC-BY\n"
    assert "build path/to/yard --seed 5 --patterns streak-0 streak-2\n" in card
    assert str(built.parents[1]) not in card
    assert "What it costs" not in card
    assert "--lens-renderer" not in card
    assert verify(built.parent) == []


@pytest.mark.parametrize(("place", "scene"), [("data", "other"), (".", ""), ("data/yard/clean", "")])
def test_scenes_are_found_by_data_folder_and_by_their_own(finished, place, scene):
    data = finished / "data"
    assert built_scenes(data) == built_scenes(data / "yard") == built_scenes(data, "yard") == [data / "yard"]
    with pytest.raises(InputError, match="no finished scene"):
        built_scenes(finished / place, scene)
