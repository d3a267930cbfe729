"""Cameras, points and pixels of a capture contradict each other: told, or refused where nothing can come of it."""

from dataclasses import replace

import numpy as np
import PIL.Image
import pytest
from painted_room import picture, points_on_walls, scene_in_room, with_cameras, write_room, write_text_model
from refusals import assert_refused

from hydroviews.formats.checks.capture import compare
from hydroviews.formats.read import read_scene
from hydroviews.scene.images import read_image, to_uint8, write_png


@pytest.fixture
def room(tmp_path):
    return scene_in_room(tmp_path / "walk")


def contradictions(folder, caplog):
    caplog.clear()
    read_scene(folder)
    return [record.message for record in caplog.records if record.levelname == "WARNING"]


@pytest.mark.parametrize("form", ["colmap", "nerfstudio"])
def test_nothing_is_said_of_a_capture_that_fits(room, tmp_path, caplog, form):
    assert contradictions(write_room(room, tmp_path / "walk", form), caplog) == []


@pytest.mark.parametrize("rain", [lambda a: 0.3 * a + 0.6, lambda a: 0.2 * a, lambda a: np.clip(2 * a - 0.5, 0, 1)])
def test_haze_night_and_exposure_are_no_contradiction(room, tmp_path, caplog, rain):
    write_room(room, tmp_path / "walk", "colmap")
    for view in room.views:
        write_png(view.path, rain(picture(view.camera)))
    assert contradictions(tmp_path / "walk", caplog) == []


def points_times(*factors):
    """The room with its points' coordinates multiplied."""
    return lambda room: replace(room, points=replace(room.points, positions=room.points.positions * factors))


def posed(change):
    """The room with other world-to-camera matrices."""
    return lambda room: with_cameras(room, change)


@pytest.mark.parametrize(
    ("change", "form", "said"),
    [
        (points_times(-1, 1, 1), "nerfstudio", "the x axis of the points is flipped"),
        (points_times(1, -1, 1), "nerfstudio", "the y axis of the points is flipped"),
        (points_times(1e3, 1e3, 1e3), "colmap", "in another unit than the cameras: 1000 times as large"),
        (points_times(1e-3, 1e-3, 1e-3), "colmap", "in another unit than the cameras: 0.001 times as large"),
        (posed(np.linalg.inv), "colmap", "the poses are inverted"),
    ],
    ids=["x flipped", "y flipped", "large", "small", "inverted"],
)
def test_cameras_that_contradict_the_points_are_told(room, tmp_path, caplog, change, form, said):
    assert said in contradictions(write_room(change(room), tmp_path / "walk", form), caplog)[0]


@pytest.mark.parametrize(
    ("change", "form", "said"),
    [
        (points_times(1, 1, -1), "nerfstudio", r"the z axis of the points is flipped[\s\S]*what to do"),
        (posed(lambda pose: np.diag([1.0, -1, -1, 1]) @ pose), "nerfstudio", "the cameras have other axes"),
        (posed(lambda pose: np.diag([-1.0, 1, -1, 1]) @ pose), "colmap", "found: cameras that look elsewhere"),
    ],
    ids=["z flipped", "other axes", "look away"],
)
def test_cameras_that_show_no_point_are_refused(room, tmp_path, change, form, said):
    assert_refused(write_room(change(room), tmp_path / "walk", form), rf"0 of 400 points are in view[\s\S]*{said}")


def test_inverted_poses_of_a_model_miss_its_keypoints(room, tmp_path, caplog):
    write_text_model(room, tmp_path / "walk" / "sparse" / "0", poses=np.linalg.inv)
    (said,) = contradictions(tmp_path / "walk", caplog)
    assert "miss its own keypoints by" in said
    assert "camera-to-world" in said


def on_their_side(scene):
    """Turn the photographs, and say so in Exif."""
    exif = PIL.Image.Exif()
    exif[0x0112] = 6
    for view in scene.views:
        PIL.Image.fromarray(np.rot90(to_uint8(picture(view.camera)))).save(view.path, exif=exif)


def test_square_photographs_on_their_side_are_told_with_what_exif_says(tmp_path, caplog):
    room = scene_in_room(tmp_path / "walk", width=80, height=80)
    on_their_side(room)
    (said,) = contradictions(write_room(room, tmp_path / "walk", "colmap"), caplog)
    assert "the photographs are turned by 90 degrees" in said
    assert "Exif's Orientation is 6: save the photographs upright" in said


def test_portraits_on_their_side_are_refused_with_what_exif_says(room, tmp_path):
    write_room(room, tmp_path / "walk", "colmap")
    on_their_side(room)
    assert_refused(tmp_path / "walk", r"64x96 pixels, by Exif's Orientation 6 to be shown as 96x64[\s\S]*upright")


def test_photographs_that_were_exchanged_are_named(room, tmp_path, caplog):
    write_room(room, tmp_path / "walk", "colmap")
    first, last = room.views[0], room.views[-1]
    write_png(first.path, picture(last.camera))
    write_png(last.path, picture(first.camera))
    (said,) = contradictions(tmp_path / "walk", caplog)
    assert said.startswith("walk: view-00, view-08: the points' colours are not those of the pixels")


def test_photographs_of_another_scene_are_told(room, tmp_path, caplog):
    write_text_model(room, tmp_path / "walk" / "sparse" / "0")
    for i, view in enumerate(room.views):
        write_png(view.path, np.random.default_rng(i).random((64, 96, 3)).astype(np.float32))
    (said,) = contradictions(tmp_path / "walk", caplog)
    assert "the points' colours are not those of the pixels (correlation" in said


@pytest.mark.parametrize("points", [points_on_walls(), points_on_walls(0)])
def test_cameras_at_one_place_are_told(room, points):
    stuck = with_cameras(replace(room, points=points), lambda _: room.views[4].camera.world_to_camera)
    (said,) = [one for one in compare(stuck) if "at one place" in one]
    assert "all 9 cameras are at one place; nothing can be learned of depth" in said


def test_large_captures_are_sampled(room, monkeypatch):
    """A few pictures of 300 views with 100,000 points are read, however many views there are."""
    read = []
    monkeypatch.setattr(
        "hydroviews.formats.checks.samples.small_picture", lambda path: read.append(path) or read_image(path)
    )
    many = tuple(replace(room.views[i % 9], name=f"{i:03d}") for i in range(300))
    assert compare(replace(room, views=many, points=points_on_walls(100_000))) == []
    assert len(read) <= 8
