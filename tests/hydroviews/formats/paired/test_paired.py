"""Folders with rainy and clean photographs: what becomes of each form, and what is refused."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from distorted import colmap_capture
from paired import NAMES, name_cameras, paired_capture, wet
from refusals import assert_refused

from hydroviews.errors import InputError
from hydroviews.files.atomic import write_json
from hydroviews.formats.read import read_scene
from hydroviews.scene.images import image_size, read_image, resize_area, write_png
from hydroviews.scene.masks import write_ignored


@pytest.fixture
def folder(tmp_path):
    """A capture with a rainy and a clean photograph of every view."""
    return paired_capture(tmp_path / "walk")


def test_rainy_and_clean_photographs_of_the_same_names_share_cameras(folder):
    scene = read_scene(folder)
    assert scene.captured_rainy
    assert [view.path.parent.name for view in scene.views] == ["rainy"] * 9
    assert [view.path.parent.name for view in scene.clean_views] == ["clean"] * 9
    for view, clean in zip(scene.views, scene.clean_views, strict=True):
        assert np.array_equal(view.camera.centre, clean.camera.centre)
    assert "paired: 9 rainy photographs, 9 clean; all views to train on are clean too" in scene.notes
    assert not any("no clean views" in note for note in scene.notes)


@pytest.mark.parametrize(
    ("rainy", "clean", "held_out"),
    [(NAMES, NAMES, NAMES[::8]), (NAMES[:6], NAMES[6:], NAMES[6:]), (NAMES, NAMES[:3], NAMES[:3])],
    ids=["the same names", "other names", "clean ones of a part"],
)
def test_clean_ones_are_held_out_where_all_have_both_every_eighth(tmp_path, rainy, clean, held_out):
    scene = read_scene(paired_capture(tmp_path / "walk", rainy, clean))
    assert [{view.name for view in views} for views in (scene.own_views, scene.clean_views)] == [set(rainy), set(clean)]
    assert scene.split.test == tuple(held_out)
    assert scene.split.train == tuple(name for name in rainy if name not in held_out)
    assert any("no ceiling" in note for note in scene.notes) == (rainy != clean)


@pytest.mark.parametrize(
    ("rainy", "clean", "found"),
    [
        (NAMES[:7], NAMES[2:], "5 names in both; rainy alone: view-00, view-01; clean alone: view-07, view-08"),
        (NAMES, NAMES[1:], "8 names in both; rainy alone: view-00; clean alone: nothing"),
        (NAMES[1:], NAMES, "8 names in both; rainy alone: nothing; clean alone: view-00"),
    ],
)
def test_names_that_match_in_part_are_listed_both_ways(tmp_path, rainy, clean, found):
    assert_refused(paired_capture(tmp_path / "walk", rainy, clean), rf"match in part[\s\S]*{found}[\s\S]*split\.json")


def test_a_split_of_ones_own_settles_it(tmp_path):
    folder = paired_capture(tmp_path / "walk", NAMES[:7], NAMES[2:])
    write_json(folder / "split.json", {"train": NAMES[:7], "test": NAMES[7:]})
    assert read_scene(folder).split.test == tuple(NAMES[7:])
    write_json(folder / "split.json", {"train": NAMES[2:], "test": NAMES[:2]})
    assert_refused(folder, r"to train on without a rainy photograph\n.*view-07, view-08")
    write_json(folder / "split.json", {"train": NAMES[2:7], "test": NAMES[:2]})
    assert_refused(folder, r"held out without a clean photograph\n.*view-00, view-01")


@pytest.mark.parametrize("empty", ["rainy", "clean"])
def test_an_empty_folder_is_named(folder, empty):
    shutil.rmtree(folder / empty)
    (folder / empty).mkdir()
    assert_refused(folder, rf"walk/{empty}: no photographs")


def test_the_same_file_in_both_folders_is_no_rain(folder):
    shutil.copy(folder / "clean" / "view-00.png", folder / "rainy" / "view-00.png")  # held out: it hurts nobody
    assert read_scene(folder).captured_rainy
    shutil.copy(folder / "clean" / "view-03.png", folder / "rainy" / "view-03.png")
    assert_refused(folder, r"the same file\n.*1 of 7 views to train on: view-03")


def test_of_two_sizes_the_smaller_is_taken(folder):
    for path in [folder / "clean" / f"{name}.png" for name in NAMES[:4]]:
        write_png(path, resize_area(read_image(path), 24, 18))
    scene = read_scene(folder)
    rainy, clean = scene.views[2], scene.clean_views[2]
    assert (rainy.camera.width, rainy.camera.height, rainy.camera.fx) == (24, 18, 0.9 * 24)
    assert rainy.image().shape == clean.image().shape == (18, 24, 3)
    assert scene.views[5].camera.width == 48
    write_png(folder / "clean" / "view-02.png", np.zeros((36, 36, 3), np.uint8))
    assert_refused(folder, r"clean/view-02\.png: image and camera differ in size\n.*36x36")


def test_photographs_without_a_camera_are_named(folder):
    wet(folder / "rainy" / "late.png", folder / "clean" / "view-00.png")
    shutil.copy(folder / "clean" / "view-01.png", folder / "clean" / "other.png")
    notes = read_scene(folder).notes
    assert "1 rainy photographs without a camera: late.png" in notes
    assert "1 clean photographs without a camera: other.png" in notes
    for path in list((folder / "clean").glob("[!.]*")):
        path.rename(path.with_name(f"dry-{path.name}"))
    assert_refused(folder, r"no clean photograph has a camera\n.*view-00[\s\S]*clean are dry-other")


def test_a_camera_without_a_photograph(tmp_path):
    folder = paired_capture(tmp_path / "walk", NAMES[:6], NAMES[:6])
    with pytest.raises(InputError, match=r"3 of its 9 images are not in .*\n.*view-06\.png, view-07\.png, view-08"):
        read_scene(folder)  # as in every COLMAP capture
    name_cameras(folder, {name: [f"rainy/{name}.png"] for name in NAMES})
    assert "no image for rainy/view-06.png, rainy/view-07.png, rainy/view-08.png" in read_scene(folder).notes


def test_suffixes_and_case_do_not_tell_photographs_apart(folder):
    for name in NAMES:
        (folder / "clean" / f"{name}.png").rename(folder / "clean" / f"{name.upper()}.PNG")
        (folder / "rainy" / f"{name}.png").rename(folder / "rainy" / f"{name}.bmp")
    (folder / "clean").rename(folder / "Clean")
    (folder / "rainy").rename(folder / "RAINY")
    scene = read_scene(folder)
    assert len(scene.own_views) == len(scene.clean_views) == 9
    shutil.copy(folder / "RAINY" / "view-00.bmp", folder / "RAINY" / "VIEW-00.png")
    assert_refused(folder, r"RAINY: several photographs of one name\n.*VIEW-00.png and view-00.bmp")


def test_where_both_photographs_have_a_camera_the_clean_ones_is_taken(tmp_path, folder):
    name_cameras(folder, {name: [f"rainy/{name}.png", f"clean/{name}.png"] for name in NAMES})
    scene = read_scene(folder)
    assert [view.name for view in scene.views] == NAMES
    assert {view.path.parent.name for view in scene.views} == {"rainy"}
    alone = read_scene(paired_capture(tmp_path / "alone"))
    moved = [view.camera.centre - other.camera.centre for view, other in zip(scene.views, alone.views, strict=True)]
    assert np.allclose(moved, [0.1, 0, 0], atol=1e-6)


@pytest.mark.parametrize("form", ["{folder}/{name}.png", "./images/{name}.jpg"])
def test_names_with_folders_in_the_camera_file(tmp_path, form):
    folder = paired_capture(tmp_path / "walk", NAMES[:6], NAMES[6:])
    folders = {name: "rainy" if name in NAMES[:6] else "clean" for name in NAMES}
    name_cameras(folder, {name: [form.format(folder=folders[name], name=name)] for name in NAMES})
    assert read_scene(folder).split.test == tuple(NAMES[6:])


def test_masks_hide_the_same_pixels_of_both(tmp_path):
    folder = paired_capture(tmp_path / "walk", NAMES[:6], NAMES[6:])
    for name in NAMES:
        write_ignored(folder / "masks" / f"{name}.png.png", np.eye(36, 48) > 0)
    scene = read_scene(folder)
    assert [view.ignored().sum() for view in (*scene.views, *scene.clean_views)] == [36] * 12


def test_both_are_undistorted_alike(tmp_path):
    folder = colmap_capture(tmp_path / "walk", count=5)
    (folder / "images").rename(folder / "clean")
    for path in (folder / "clean").glob("[!.]*"):
        wet(folder / "rainy" / path.name, path)
    scene = read_scene(folder).resized(24)
    for rainy, clean in zip(scene.views, scene.clean_views, strict=True):
        assert rainy.lens is not None
        assert rainy.lens == clean.lens
        assert rainy.image().shape == clean.image().shape
        assert (rainy.image() >= clean.image() - 1e-6).all()  # brighter in its right half, nowhere darker
        assert (rainy.image() > clean.image() + 0.1).any()


def renamed(folder: Path, kinds: dict[str, list[str]], without: str = "") -> Path:
    """The clean photographs in one folder, under prefixed names, `clutter` ones wet; one kind has no cameras."""
    frames = {}
    for kind, names in kinds.items():
        for name in names:
            target = folder / "images" / f"{kind}{name[-2:]}.png"
            target.parent.mkdir(exist_ok=True)
            if kind.endswith("clutter"):
                wet(target, folder / "clean" / f"{name}.png")
            else:
                shutil.copy(folder / "clean" / f"{name}.png", target)
            if kind != without:
                frames[name] = [f"images/{target.name}"]
    for part in ("clean", "rainy"):
        shutil.rmtree(folder / part)
    name_cameras(folder, frames)
    return folder


@pytest.mark.parametrize("number", ["", "2"])
def test_clutter_is_trained_on_and_extra_held_out(folder, number):
    kinds = {f"{number}clutter": NAMES[:4], "clean": NAMES[4:6], "extra": NAMES[6:]}
    renamed(folder, kinds)
    scene = read_scene(folder)
    assert scene.split.train == tuple(f"{number}clutter0{i}" for i in range(4))
    assert scene.split.test == ("extra06", "extra07", "extra08")
    assert [view.name for view in scene.clean_views] == ["extra06", "extra07", "extra08"]
    assert "2 views neither to train on nor held out: clean04, clean05" in scene.notes
    for path in (folder / "images").glob("extra*"):
        path.unlink()
    assert read_scene(folder).split.test == ("clean04", "clean05")


def test_two_clutter_photographs_of_one_name_but_for_their_number_are_refused(folder):
    kinds = {"1clutter": NAMES[:4], "2clutter": NAMES[3:6], "extra": NAMES[6:]}
    with pytest.raises(InputError, match=r"two clutter photographs[\s\S]*1clutter03.png, 2clutter03.png"):
        read_scene(renamed(folder, kinds))


def test_clean_without_a_camera_is_the_clean_one_of_the_same_clutter(folder):
    kinds = {"clean": NAMES[:5], "clutter": NAMES[:5], "extra": NAMES[5:]}
    scene = read_scene(renamed(folder, kinds, without="clean"))
    assert len(scene.split.train) == 5
    assert {view.name for view in scene.clean_views} == {*scene.split.train, *scene.split.test}
    assert "all views to train on are clean too" in scene.notes[-1]


def test_a_split_of_numbers(folder):
    renamed(folder, {"frame": NAMES[::-1]})
    for path in list((folder / "images").glob("frame*")):
        wet(path, path)
    write_json(folder / "split.json", {"clutter": [1, 3, 5, 7], "extra": [0, 2]})
    scene = read_scene(folder)
    assert scene.split.train == ("frame01", "frame03", "frame05", "frame07")
    assert scene.split.test == tuple(view.name for view in scene.clean_views) == ("frame00", "frame02")
    assert "3 views neither to train on nor held out: frame04, frame06, frame08" in scene.notes
    no_number = r"numbers of photographs that are not there\n.*clutter: 9"
    for clutter, message in (([1, 9], no_number), (["a"], "not a split")):
        write_json(folder / "split.json", {"clutter": clutter, "extra": [0, 2]})
        assert_refused(folder, rf"split\.json: {message}")


def test_other_names_are_an_ordinary_capture(folder):
    kinds = {"clutter": NAMES[:4], "view": NAMES[4:]}
    scene = read_scene(renamed(folder, kinds))
    assert not scene.captured_rainy
    assert image_size(scene.views[0].path) == (48, 36)
