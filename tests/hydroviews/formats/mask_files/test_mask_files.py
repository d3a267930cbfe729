"""Masks of other programs hide what they are meant to; those that hide nothing are told."""

import cv2
import numpy as np
import pytest
from painted_room import picture, scene_in_room, write_room

from hydroviews.__main__ import poses_command
from hydroviews.formats.photographs import photographs_below
from hydroviews.formats.read import read_scene
from hydroviews.scene.images import write_png
from hydroviews.scene.masks import read_ignored

HIDDEN = np.zeros((64, 96), bool)
HIDDEN[20:40, 30:60] = True
GREY = np.where(HIDDEN, np.uint8(0), np.uint8(255))


@pytest.fixture
def capture(tmp_path):
    """Nine JPEGs; a model of them."""
    scene = scene_in_room(tmp_path / "walk")
    for view in scene.views:
        cv2.imwrite(str(view.path.with_suffix(".jpg")), cv2.imread(str(view.path)))
        view.path.unlink()
    return write_room(scene, tmp_path / "walk", "colmap")


def write_masks(capture, name, pixels=GREY, count=9):
    for i in range(count):
        path = capture / name.format(f"view-{i:02d}")
        path.parent.mkdir(exist_ok=True)
        assert cv2.imwrite(str(path), pixels)


def warnings(caplog):
    return [record.message for record in caplog.records if record.levelname == "WARNING"]


def hidden_shares(scene):
    return [0.0 if (ignored := view.ignored()) is None else ignored.mean() for view in scene.views]


OTHER_NAMES = [
    "masks/{}.jpg.png",
    "masks/{}.png",
    "masks/{}.jpg",
    "masks/{}.JPG.png",
    "masks/{}.mask.png",
    "masks/{}.jpg.mask.png",
    "masks/{}_mask.png",
    "masks/mask_{}.png",
    "images/{}_mask.png",
    "mask/{}.png",
    "Masks/{}.jpg.png",
    "masks_2/{}.png",
    "dynamic_masks/{}.png",
    "segmentation/{}.png",
    "masks/mask.png",
]


@pytest.mark.parametrize("name", OTHER_NAMES)
def test_masks_of_other_names_hide_the_same(capture, caplog, name):
    write_masks(capture, name)
    scene = read_scene(capture)
    assert np.allclose(hidden_shares(scene), HIDDEN.mean(), atol=0.01)
    assert "9 of 9 views have a mask" in scene.notes
    assert any(note.startswith(f"masks hide {HIDDEN.mean():.1%} of the pixels") for note in scene.notes)
    assert "cameras from sparse/0: 9 of 9 images registered" in scene.notes
    assert warnings(caplog) == []


def test_white_is_hidden_in_dynamic_masks(capture):
    write_masks(capture, "images/dynamic_mask_{}.png", 255 - GREY)
    assert np.allclose(hidden_shares(read_scene(capture)), HIDDEN.mean())
    assert len(photographs_below(capture / "images")) == 9


def test_masks_for_some_name_the_others(capture, caplog):
    write_masks(capture, "masks/{}.jpg.png", count=2)
    write_masks(capture, "masks/{}_mask.png", count=4)
    for name in ("view-00", "view-01"):
        (capture / f"masks/{name}_mask.png").unlink()
    scene = read_scene(capture)
    assert np.allclose(hidden_shares(scene), [HIDDEN.mean()] * 4 + [0] * 5)
    assert "without a mask, and shown whole: view-04, view-05, view-06, view-07, view-08" in scene.notes
    assert warnings(caplog) == []


@pytest.mark.parametrize(
    ("files", "pixels", "message"),
    [
        ({"{}.jpg": 7, "other-{}": 2}, GREY, "2 masks fit no photograph and hide nothing (other-view-00.png, "),
        ({"IMG_{}": 9}, GREY, "none is named as it should be, such as view-00.jpg.png"),
        ({"{}": 9}, np.full_like(GREY, 255), "9 masks hide nothing"),
    ],
    ids=["some fit", "none fits", "all white"],
)
def test_masks_that_hide_nothing_are_warned_of(capture, caplog, files, pixels, message):
    for name, count in files.items():
        write_masks(capture, f"masks/{name}.png", pixels, count)
    scene = read_scene(capture)
    (said,) = warnings(caplog)
    assert message in said
    assert ("masks hide 0.0% of the pixels" in scene.notes) == (message == "9 masks hide nothing")


CUT_OUT = np.random.default_rng(0).integers(0, 256, (64, 96, 3)).astype(np.uint8)
OTHER_VALUES = {
    "10 of 255": np.maximum(GREY, 10),
    "greys": np.where(HIDDEN, np.uint8(90), np.uint8(160)),
    "0 and 1": GREY // 255,
    "0 and 3": (GREY // 255) * np.uint8(3),
    "alpha alone": np.dstack([np.full_like(CUT_OUT, 255), GREY]),
    "alpha and black": np.dstack([GREY] * 4),
    "cut out": np.dstack([CUT_OUT, GREY]),
    "16 bits": GREY.astype(np.uint16) * 257,
}


@pytest.mark.parametrize("pixels", OTHER_VALUES.values(), ids=OTHER_VALUES)
def test_masks_of_other_values_hide_the_same(tmp_path, pixels):
    cv2.imwrite(str(tmp_path / "mask.png"), pixels)
    assert np.array_equal(read_ignored(tmp_path / "mask.png"), HIDDEN)


def test_masks_after_jpeg_hide_the_same_but_for_the_edges(tmp_path):
    cv2.imwrite(str(tmp_path / "mask.jpg"), GREY, [cv2.IMWRITE_JPEG_QUALITY, 60])
    assert (read_ignored(tmp_path / "mask.jpg") == HIDDEN).mean() > 0.995


def test_transparent_pixels_of_photographs_are_hidden_and_no_black_holes(tmp_path, caplog):
    scene = scene_in_room(tmp_path / "walk")
    for view in scene.views:
        cv2.imwrite(str(view.path), np.dstack([cv2.imread(str(view.path)), GREY]))
    read = read_scene(write_room(scene, tmp_path / "walk", "colmap"))
    assert np.allclose(hidden_shares(read), HIDDEN.mean())
    assert "transparent pixels of 9 photographs are hidden" in read.notes
    assert np.abs(read.views[3].image() - picture(scene.views[3].camera)).max() < 0.003
    assert np.array_equal(read.views[3].rounded(), (255 * read.views[3].image() + 0.5).astype(np.uint8))
    assert warnings(caplog) == []


def test_masks_are_no_photographs(tmp_path):
    for name in ("images/a.jpg", "images/mask_of_gold.jpg", "images/a_mask.jpg", "masks/a.png", "masks/b.png"):
        write_png(tmp_path / name, np.zeros((4, 4, 3), np.float32))
    assert photographs_below(tmp_path) == [tmp_path / "images/a.jpg", tmp_path / "images/mask_of_gold.jpg"]
    assert len(photographs_below(tmp_path / "masks")) == 2


def test_masks_beside_photographs_without_cameras_are_told(capture, tmp_path, caplog, monkeypatch):
    write_masks(capture, "masks/{}.jpg.png")
    monkeypatch.setattr("hydroviews.__main__.estimate_poses", lambda *_, **__: read_scene(capture))
    poses_command(capture / "images", tmp_path / "out")
    said = " ".join(warnings(caplog))
    assert f"{capture / 'masks'}: masks are not used to estimate cameras" in said
    assert f"copy them to {tmp_path / 'out' / 'masks'}" in said
