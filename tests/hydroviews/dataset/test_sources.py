from pathlib import Path
from unittest.mock import Mock

import pytest
from distorted import colmap_capture, write_model, write_photographs

from hydroviews import __main__ as commands
from hydroviews.dataset import sources
from hydroviews.dataset.checks.verify import verify
from hydroviews.dataset.manifest import require_outside_scenes
from hydroviews.dataset.sources import build_source, choose_images, find_capture
from hydroviews.errors import InputError
from hydroviews.formats.capture_json import CAPTURED
from hydroviews.profiles import find_profile
from hydroviews.scene.images import read_image, resize_area, write_png

NAMES = [f"view{i}.png" for i in range(5)]


@pytest.fixture(autouse=True)
def no_captures_of_this_machine(monkeypatch, tmp_path):
    monkeypatch.delenv("HYDROVIEWS_CAPTURES", raising=False)
    monkeypatch.chdir(tmp_path)


SIZES = {"images_2": (48, 36), "images_4": (24, 18), "images_8": (12, 9)}


def published(folder: Path, *parts: str) -> Path:
    """A COLMAP project with the same photographs at several sizes, the largest one the lens's."""
    write_model(folder / "sparse" / "0", NAMES)
    write_photographs(folder / "images", NAMES)
    for part in parts:
        for photograph in NAMES:
            write_png(folder / part / photograph, resize_area(read_image(folder / "images" / photograph), *SIZES[part]))
    return folder


@pytest.fixture
def root(tmp_path):
    published(tmp_path / "root" / "360_v2" / "garden", "images_2", "images_4", "images_8")
    return tmp_path / "root"


@pytest.fixture
def built(tmp_path):
    """Builds a capture in the folder `data`, small."""
    return lambda path, **how: build_source(str(path), tmp_path / "data", find_profile("demo"), long_side=24, **how)


@pytest.mark.parametrize("name", ["manifest.json", "captures"])
def test_a_capture_may_be_called_like_what_a_data_folder_holds(built, tmp_path, name):
    folder = built(colmap_capture(tmp_path / "mine" / name))
    assert folder == tmp_path / "data" / f"{name}-scene"
    assert f"built as {name}-scene" in (folder / "README.md").read_text()
    assert verify(tmp_path / "data") == []


def test_photographs_without_cameras_get_them_before_they_are_built(tmp_path, monkeypatch):
    poses = Mock(side_effect=lambda images, out: colmap_capture(out, count=len(NAMES)))
    monkeypatch.setattr(commands, "poses_command", poses)
    write_photographs(tmp_path / "walk", NAMES)
    for source in ("walk", "walk-capture"):  # a capture has cameras
        commands.build_command(source, out=tmp_path / "data", patterns=("streak-0",), long_side=24)
    poses.assert_called_once_with(Path("walk"), tmp_path / "walk-capture")
    assert len(list((tmp_path / "data/walk-capture/streak-0/images").iterdir())) == len(NAMES)


def test_a_build_that_is_refused_estimates_no_cameras(tmp_path, monkeypatch):
    """Neither one with a misspelt pattern, nor one whose clean views would be photographs the next time."""
    monkeypatch.setattr(commands, "poses_command", pytest.fail)
    write_photographs(tmp_path / "walk", NAMES)
    with pytest.raises(InputError, match="streakk-1"):
        commands.build_command("walk", out=tmp_path / "data", patterns=("streakk-1",))
    with pytest.raises(InputError, match="seed"):
        commands.build_command("walk", out=tmp_path / "data", seed=-1)
    monkeypatch.chdir(tmp_path / "walk")
    with pytest.raises(InputError, match=r"--out data/demo: among the photographs[\s\S]*another --out"):
        commands.build_command(".", patterns=("streak-0",))


def test_results_do_not_go_into_built_scenes(built, tmp_path):
    """They would count as the scene's own: packed with it, and removed when it is built anew."""
    folder = built(colmap_capture(tmp_path / "room"))
    with pytest.raises(InputError, match=r"in the built scene .*room\n.*outside of the data folder"):
        commands.poses_command(folder / "clean", out=folder / "capture")
    with pytest.raises(InputError, match=r"in the built scene .*room\n"):
        commands.video_command(tmp_path / "walk.mp4", out=folder / "walk")
    require_outside_scenes(tmp_path / "data" / "walk-scene")


def test_an_embedded_scene_is_not_downloaded(capsys, tmp_path):
    commands.download_command("room", captures=tmp_path)
    assert "room comes with the package: `hydroviews build room`" in capsys.readouterr().out
    assert not list(tmp_path.iterdir())


def test_two_captures_of_one_name_are_told_apart(built, tmp_path):
    built(colmap_capture(tmp_path / "a" / "room"))
    with pytest.raises(InputError, match=r"of .*/a/room, another capture than .*/b/room\n"):
        built(colmap_capture(tmp_path / "b" / "room", count=5))


@pytest.mark.parametrize("content", ['{"sou', "[1]"])
def test_a_damaged_request_is_overwritten(built, tmp_path, content):
    capture, request = colmap_capture(tmp_path / "room"), tmp_path / "data" / "room" / "request.json"
    request.parent.mkdir(parents=True)
    request.write_text(content)
    with pytest.raises(InputError, match="--overwrite"):
        built(capture)
    built(capture, overwrite=True)
    assert verify(tmp_path / "data") == []


def find(source, root=None, long_side=20):
    return find_capture(source, Path("rendered"), 40, long_side, root)


@pytest.mark.parametrize("source", ["garden", "mipnerf360/garden", "360_v2/garden"])
def test_a_capture_is_read_by_name(root, source):
    scene = find(source, root)
    assert scene.name == "mipnerf360_garden"
    assert {view.path.parent for view in scene.views} == {root / "360_v2" / "garden" / "images_4"}
    assert not scene.captured_rainy


@pytest.mark.parametrize(
    ("long_side", "published_for", "folder"),
    [
        (1600, "images_4", "images_4"),  # never larger than what results are published for
        (25, "images_2", "images_2"),
        (24, "images_2", "images_4"),
        (20, "images_4", "images_4"),
        (5, "images", "images_8"),
    ],
)
def test_no_larger_photographs_are_read_than_needed(root, long_side, published_for, folder):
    assert choose_images(root / "360_v2" / "garden", published_for, long_side) == (folder, [])


def test_other_sizes_are_taken_and_noted(tmp_path):
    folder = published(tmp_path / "root" / "garden", "images_2")
    assert choose_images(folder, "images_4", 1600)[0] == "images"
    assert choose_images(folder, "images_4", 30)[0] == "images_2"
    notes = find("garden", tmp_path / "root").notes
    assert "no images_4, for which results are published: views come from images_2" in notes
    assert choose_images(tmp_path, "images_4", 30) == (None, [])


def test_an_embedded_scene_wins_over_a_published_one(root, monkeypatch):
    published(root / "360_v2" / "room")
    monkeypatch.setattr(sources, "EMBEDDED", ("courtyard", "room"))
    monkeypatch.setattr(sources, "render_embedded", lambda name, folder, *size, seed: None)
    monkeypatch.setattr(sources, "read_embedded", lambda name, folder: (name, str(folder)))
    assert find("room", root) == ("room", "rendered/room-40-20x15")
    assert find("mipnerf360/room", root).name == "mipnerf360_room"


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("tanksandtemples/horse", "has no horse"),
        ("mipnerf360", r"several captures[\s\S]*mipnerf360/stump"),
        ("moon", r"SCENE=moon: no such capture[\s\S]*mipnerf360/garden"),
        ("mipnerf360/moon", r"SCENE=mipnerf360/moon: no such capture[\s\S]*mipnerf360/garden"),
        ("my/yard", r"SCENE=my/yard: no such folder"),  # meant as a path
    ],
)
def test_what_is_not_there_is_named(root, source, message):
    with pytest.raises(InputError, match=message):
        find(source, root)


def test_what_is_not_there_says_where_to_get_it(root):
    with pytest.raises(InputError) as error:
        find("mipnerf360/bicycle", root)
    said = [str(root / "360_v2" / "bicycle"), str(root / "mipnerf360_bicycle"), "HYDROVIEWS_CAPTURES"]
    said += ["hydroviews download mipnerf360/bicycle"]
    said += ["https://storage.googleapis.com/gresearch/refraw360/360_v2.zip"]
    assert [one for one in said if one not in str(error.value)] == []


def test_own_captures_by_path_or_by_name_in_the_folder(root, tmp_path):
    published(root / "my yard")
    assert find("my yard", root).name == "my yard"
    assert find(str(root / "my yard")).name == "my yard"
    published(tmp_path / "garden")  # a folder of a published name, here
    assert find("garden", tmp_path / "empty").views[0].path.parent == Path("garden/images")
    note = find("garden", tmp_path / "empty").notes[-1]
    assert "read as the published mipnerf360/garden" in note
    assert str(tmp_path) not in note  # the manifest has it, and data are handed on
    assert find("./garden", root).name == "garden"


def test_a_scene_captured_in_rain_gets_none(tmp_path):
    published(tmp_path / "root" / "waterdrops" / "church")
    settings = {"out": tmp_path / "data", "profile": find_profile("demo"), "captures": tmp_path / "root"}
    folder = build_source("church", **settings, all_patterns=True)
    assert folder.name == "waterdrops_church"
    assert sorted(p.name for p in folder.iterdir() if p.is_dir()) == [CAPTURED, "sparse"]
    with pytest.raises(InputError, match="taken in rain, and streak-1 is not added to that"):
        build_source("church", **settings, patterns=["streak-1"])
