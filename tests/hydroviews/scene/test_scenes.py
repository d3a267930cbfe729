import json
from dataclasses import replace

import numpy as np
import pytest
from synthetic import capture_in

from hydroviews.errors import InputError
from hydroviews.formats.photographs import read_split
from hydroviews.scene.images import write_png
from hydroviews.scene.scenes import Split, every_third, make_scene, no_points


def test_views_are_sorted_and_split(tmp_path):
    scene = capture_in(tmp_path)
    again = make_scene("again", scene.views[::-1], scene.points)
    assert again.views == scene.views
    assert [view.name for view in again.test_views] == ["view-00", "view-08"]
    assert len(again.train_views) == 7
    given = make_scene("given", scene.views, no_points(), Split(("view-03", "view-01"), ("view-02",)))
    assert [view.name for view in given.train_views] == ["view-03", "view-01"]


def test_resized_scene_averages_its_images(tmp_path):
    scene = capture_in(tmp_path)
    view, small = scene.views[0], scene.resized(24).views[0]
    assert (small.camera.width, small.camera.height) == (24, 18)
    expected = view.image().reshape(18, 2, 24, 2, 3).mean(axis=(1, 3))
    np.testing.assert_allclose(small.image(), expected, atol=1e-6)
    assert scene.resized(None).views[0].camera.matrix.tolist() == view.camera.matrix.tolist()


@pytest.mark.parametrize("size", [(36, 48), (48, 35), (24, 18), (60, 36)])
def test_image_that_does_not_fit_its_camera(tmp_path, size):
    view = capture_in(tmp_path).views[4]
    write_png(view.path, np.zeros((size[1], size[0], 3), np.float32))
    with pytest.raises(InputError, match=rf"view-04\.png.*differ in size\n.*{size[0]}x{size[1]} pixels\n.*48x36"):
        view.image()


NAMES = tuple(f"view-{i:02d}" for i in range(9))


@pytest.mark.parametrize(
    ("views", "split", "message"),
    [
        ((), None, "no view with a camera"),
        ((*NAMES, NAMES[1]), None, r"share a name\n.*view-01"),
        (NAMES[:2], None, r"too few views\n.*1 to train on, 1 held out"),
        (NAMES, Split(("view-01", "view-99"), ("view-02",)), r"not there\n.*view-99"),
        (NAMES, Split(("view-01", "view-02"), ()), "2 to train on, 0 held out"),
        (NAMES, Split(("view-00", "view-01"), ("view-00",)), "lists views twice"),
        (NAMES, Split(("view-01", "view-01", "view-02"), ("view-00",)), "lists views twice"),
        *(
            (NAMES, Split(NAMES[1:], NAMES[:1], ("view-01", *other)), "no choice of its training views")
            for other in ((), ("view-01",), ("view-00",), ("x",))
        ),
    ],
    ids=["none", "twice", "few", "absent", "no test", "both", "trained twice", "one", "same", "held out", "unknown"],
)
def test_scenes_that_are_none(tmp_path, views, split, message):
    of_name = {view.name: view for view in capture_in(tmp_path).views}
    with pytest.raises(InputError, match=message):
        make_scene("yard", [of_name[name] for name in views], no_points(), split)


@pytest.mark.parametrize(
    ("train", "sparse"), [("abcdefg", "adg"), ("gfedcba", "adg"), ("abcd", "ad"), ("abc", "ac"), ("ab", "ab")]
)
def test_every_third_training_view_is_a_sparse_one_and_there_are_two(train, sparse):
    assert every_third(list(train)) == tuple(sparse)


def test_a_scene_of_sparse_views(tmp_path):
    scene = capture_in(tmp_path / "yard")
    chosen = replace(scene.split, sparse=("view-05", "view-02"))
    given = make_scene("yard", scene.views, scene.points, chosen)
    for one, expected in ((scene, ("view-01", "view-04", "view-07")), (given, ("view-05", "view-02"))):
        assert one.split.sparse == expected
        assert tuple(view.name for view in one.sparse().train_views) == expected
        assert one.sparse().test_views == scene.test_views


def test_a_split_file_names_sparse_views_or_none(tmp_path):
    def split_with(**sparse):
        (tmp_path / "split.json").write_text(json.dumps({"train": ["a", "c"], "test": ["b"], **sparse}))
        return read_split(tmp_path)

    assert split_with() == Split(("a", "c"), ("b",), ())
    assert split_with(sparse=["c", "a"]) == Split(("a", "c"), ("b",), ("a", "c"))  # in order of name, which is time
    for odd in (3, ["a", 4], "a"):
        with pytest.raises(InputError, match="not a split"):
            split_with(sparse=odd)
