import re
from collections import Counter

import pytest

from hydroviews.blender.embedded_scenes.captures import EMBEDDED
from hydroviews.captures.catalogue.catalogue import all_captures, find_captures, locate
from hydroviews.dataset.suites import known_suites, read_suite
from hydroviews.errors import InputError

MIPNERF360 = {"bicycle", "bonsai", "counter", "garden", "kitchen", "room", "stump"}


def test_the_catalogue_names_every_capture_once():
    captures = all_captures()
    assert {c.scene for c in captures if c.collection == "mipnerf360"} == MIPNERF360
    assert {c.scene for c in captures if c.collection == "tanksandtemples"} == {"horse", "train", "truck"}
    assert {"church", "factory", "tanabata"} < {c.scene for c in captures if c.collection == "waterdrops"}
    names = [name for capture in captures for name in capture.spellings]
    assert max(Counter(names).values()) == 1
    built = [capture.folder_name for capture in captures]
    assert len(set(built) | set(EMBEDDED)) == len(built) + len(EMBEDDED)


def test_everything_can_be_had_somehow():
    for capture in all_captures():
        assert (capture.archive is None) != (capture.by_hand == ""), capture.name
        assert capture.page.startswith("https://")
        for url in capture.archive.urls if capture.archive else ():
            assert re.fullmatch(f"https?://.*/{re.escape(capture.archive.name)}", url)


@pytest.mark.parametrize(
    "name", ["mipnerf360/garden", "garden", "360_v2/garden", "mipnerf360_garden", "MipNeRF360/Garden", "garden/"]
)
def test_a_capture_has_several_spellings(name):
    assert [capture.name for capture in find_captures(name)] == ["mipnerf360/garden"]


def test_a_collection_is_all_of_its_captures():
    assert {capture.scene for capture in find_captures("mipnerf360")} == MIPNERF360
    assert find_captures("") == find_captures("gard") == find_captures("./garden") == find_captures("/garden") == []


@pytest.mark.parametrize(
    "folder", ["360_v2/garden", "mipnerf360/garden", "mipnerf360_garden", "garden", "360_V2/Garden"]
)
def test_a_capture_is_found_in_every_usual_folder(tmp_path, folder):
    (garden,) = find_captures("garden")
    (tmp_path / folder).mkdir(parents=True)
    assert locate(garden, tmp_path) is None  # nothing in it
    (tmp_path / folder / "images").mkdir()
    assert locate(garden, tmp_path) == tmp_path / folder
    assert locate(garden, tmp_path / "elsewhere") is None


def test_the_papers_suite_is_the_papers_table():
    suite = read_suite("paper")
    window, streaks = (
        {scene.rpartition("/")[2] for scene, effects in suite.scenes.items() if effect in effects}
        for effect in ("window", "streak")
    )
    assert window == MIPNERF360
    assert streaks == {"bicycle", "garden", "kitchen", "stump", "horse", "train", "truck"}
    assert suite.patterns == (0, 1, 2)


@pytest.mark.parametrize("name", known_suites())
def test_suites_name_known_captures(name):
    for scene in read_suite(name).scenes:
        alone = (*EMBEDDED, "llff_flower", "ngp_fox")  # folders that no catalogue lists
        assert scene in alone or [c.name for c in find_captures(scene)] == [scene]


def test_no_scene_is_for_development_and_for_the_test():
    development, test = (set(read_suite(name).scenes) for name in ("development", "test"))
    assert not development & test
    assert set(EMBEDDED) <= development | test


@pytest.mark.parametrize(
    ("content", "message"),
    [
        *((content, "not a suite") for content in ("scenes = 3", "[scenes]", "title = 'x'", "[scene]\ngarden = []")),
        *((f"[scenes]\ngarden = {odd}", "effects of garden") for odd in ("['hail']", "'streak'", "[['streak']]")),
        ("patterns = []\n[scenes]\ngarden = ['streak']", "patterns"),
        ("patterns = ['streak-0']\n[scenes]\ngarden = []", "patterns"),
        ("[scenes", "not valid TOML"),
    ],
)
def test_what_is_no_suite_is_refused(tmp_path, content, message):
    (tmp_path / "own.toml").write_text(content)
    with pytest.raises(InputError, match=message):
        read_suite(str(tmp_path / "own.toml"))
    with pytest.raises(InputError, match="no such suite"):
        read_suite("moon")
