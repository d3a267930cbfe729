"""A capture's own split is used, in whatever form it has one, and told."""

import json
import shutil

import pytest
from painted_room import scene_in_room, write_room

from hydroviews.formats.read import has_cameras, read_scene

NAMES = [f"view-{i:02d}" for i in range(9)]
TEST = ("view-03", "view-04", "view-05")
TRAIN = tuple(name for name in NAMES if name not in TEST)


@pytest.fixture(params=["colmap", "nerfstudio"])
def capture(tmp_path, request):
    return write_room(scene_in_room(tmp_path / "walk"), tmp_path / "walk", request.param)


in_nerfstudio = pytest.mark.parametrize("capture", ["nerfstudio"], indirect=True)


def split_of(folder):
    scene = read_scene(folder)
    assert {view.name for view in scene.views} == {*scene.split.train, *scene.split.test}
    return scene.split.train, scene.split.test, " ".join(scene.notes)


def with_lists(folder, form="{}.png"):
    for part, names in (("train", TRAIN), ("test", TEST)):
        (folder / f"{part}_list.txt").write_text("".join(f"{form.format(name)}\n" for name in names) + "\n")


@pytest.mark.parametrize("form", ["{}.png", "images/{}.png", "{}.jpg", "images\\{}.png"])
def test_lists_of_nerfbaselines(capture, form):
    with_lists(capture, form)
    train, test, said = split_of(capture)
    assert (train, test) == (TRAIN, TEST)
    assert "split of train_list.txt, test_list.txt: 6 views to train on, 3 held out" in said


def test_split_json_goes_before(capture):
    with_lists(capture)
    (capture / "split.json").write_text(json.dumps({"train": NAMES[:8], "test": NAMES[8:]}))
    assert split_of(capture)[:2] == (tuple(NAMES[:8]), tuple(NAMES[8:]))


def test_the_table_of_nerf_in_the_wild(capture):
    rows = [f"{name}.png\t{i}\t{'test' if name in TEST else 'train'}\troom" for i, name in enumerate(NAMES[:-1])]
    (capture / "room.tsv").write_text("\n".join(["filename\tid\tsplit\tdataset", *rows, "view-08.png\t9\t\troom"]))
    train, test, said = split_of(capture)
    assert (train, test) == (TRAIN[:-1], TEST)
    assert "split of room.tsv: 5 views to train on, 3 held out; 1 in neither left out" in said


def test_a_split_of_other_photographs_is_not_used_and_told(capture, caplog):
    with_lists(capture, "other-{}.png")
    assert split_of(capture)[1] == ("view-00", "view-08")
    assert "the split of train_list.txt, test_list.txt is not used" in caplog.text


@in_nerfstudio
@pytest.mark.parametrize("parts", [("train", "test"), ("train", "val", "test"), ("train", "val"), ("test",)])
def test_names_of_files_in_transforms(capture, parts):
    path = capture / "transforms.json"
    content = json.loads(path.read_text())
    for part in parts:
        content[f"{part}_filenames"] = [f"images/{name}.png" for name in (TRAIN if part == "train" else TEST)]
    path.write_text(json.dumps(content))
    train, test, said = split_of(capture)
    assert (train, test) == (TRAIN, TEST)
    assert "split of transforms.json: 6 views to train on, 3 held out" in said


@in_nerfstudio
def test_a_file_for_each_part(capture):
    """As Blender captures have them: names without suffix, one field of view."""
    frames = json.loads((capture / "transforms.json").read_text())["frames"]
    for part, numbers in (("train", range(6)), ("test", range(6, 8)), ("val", range(8, 9))):
        own = [{**frames[i], "file_path": f"./{part}/r_{i}"} for i in numbers]
        (capture / f"transforms_{part}.json").write_text(json.dumps({"camera_angle_x": 1.1171, "frames": own}))
        (capture / part).mkdir()
        for i in numbers:
            shutil.move(capture / frames[i]["file_path"], capture / part / f"r_{i}.png")
    (capture / "transforms.json").unlink()
    assert has_cameras(capture)
    scene = read_scene(capture)
    assert scene.split.train == tuple(f"r_{i}" for i in range(6))
    assert scene.split.test == ("r_6", "r_7")
    said = "split of transforms_train.json, transforms_val.json, transforms_test.json: 6 views to train on, 2 held out"
    assert f"{said}; 1 in neither left out" in scene.notes
    assert scene.views[0].camera.fx == pytest.approx(0.8 * 96, rel=1e-3)
