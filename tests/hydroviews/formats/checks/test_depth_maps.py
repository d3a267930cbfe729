"""Depth maps that contradict the points are refused with what they are; holes are filled from the points."""

import numpy as np
import OpenEXR
import painted_room
import PIL.Image
import pytest
from painted_room import depth, scene_in_room, write_room
from refusals import assert_refused

from hydroviews.dataset.clean_views import write_views
from hydroviews.formats.read import read_scene
from hydroviews.scene.depth import depth_path, read_depth, view_depth


@pytest.fixture
def with_maps(tmp_path):
    """Writes a capture whose depth maps are the exact ones, changed, under names made of the view's."""

    def write(change=lambda z: z, name="{}.exr"):
        room = scene_in_room(tmp_path / "walk")
        (tmp_path / "walk" / "depth").mkdir()
        for view in room.views:
            z = np.ascontiguousarray(change(depth(view.camera)))
            path = tmp_path / "walk" / "depth" / name.format(view.name)
            if path.suffix == ".png":
                PIL.Image.fromarray(z.round().astype(np.uint16)).save(path)
            else:
                header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
                OpenEXR.File(header, {"Z": z.astype(np.float32)}).write(str(path))
        return write_room(room, tmp_path / "walk", "colmap")

    return write


def other_view(z):
    return np.random.default_rng(1).lognormal(2, 1, z.shape)


@pytest.mark.parametrize(
    ("change", "what", "found"),
    [
        (lambda z: 1000 * z, "1,000 times as far as the points", "millimetres beside metres"),
        (lambda z: z / 1000, "0.001 times as far as the points", "metres beside millimetres"),
        (lambda z: 2.5 * z, "2.5 times as far as the points", "another unit"),
        (lambda z: 1 / z, "far is near", "disparity"),
        (lambda z: -z, "without depth", "values below 0"),
        (lambda z: 0 * z, "without depth", "hardly any value above 0"),
        (other_view, "not that of the points", "maps of other views"),
    ],
    ids=["millimetres", "kilometres", "scaled", "disparity", "negative", "empty", "other view"],
)
def test_maps_that_contradict_the_points_are_refused_with_what_they_are(with_maps, change, what, found):
    message = rf"the depth maps contradict the capture's points.*{what}[\s\S]*{found}[\s\S]*depth is then taken from"
    assert_refused(with_maps(change), message)


def test_maps_upside_down_are_refused(with_maps, monkeypatch):
    """The walls of this room are as far above as below, so that the camera is put near its floor."""
    monkeypatch.setattr(painted_room, "HIGH", np.array([3.0, 0.6, 6.0]))
    assert_refused(with_maps(lambda z: z[::-1]), r"contradict[\s\S]*upside down")


FITTING = (lambda z: z, lambda z: z[::2, ::2], lambda z: np.where(z > 6.4, np.inf, z), lambda z: 1.1 * z)


@pytest.mark.parametrize("change", FITTING)
def test_maps_that_fit_are_taken_without_a_word(with_maps, caplog, change):
    """Also where sky is infinite, the map is smaller, or it has distances along the rays."""
    read_scene(with_maps(change))
    assert [record for record in caplog.records if record.levelname == "WARNING"] == []


@pytest.mark.parametrize(
    ("name", "change"), [("{}.png.exr", lambda z: z), ("{}_depth.exr", lambda z: z), ("{}.png", lambda z: 1000 * z)]
)
def test_other_names_and_16_bit_millimetres_are_read(with_maps, name, change):
    scene = read_scene(with_maps(change, name))
    view = scene.views[3]
    assert np.abs(read_depth(depth_path(view)) - depth(view.camera)).max() < 1e-3


def test_files_that_are_read_for_no_view_are_named(with_maps, caplog):
    folder = with_maps(name="of {}.exr")
    scene = read_scene(folder)
    assert not depth_path(scene.views[0]).is_file()
    assert f"{folder}/depth: 9 files are not read (of view-00.exr, " in caplog.text
    assert "called view-00.exr" in caplog.text


def test_holes_are_filled_from_the_points(with_maps, tmp_path, caplog):
    """As of a sensor that sees up to 5 units: what lies farther is no sky."""
    scene = read_scene(with_maps(lambda z: np.where(z < 5, z, 0)))
    assert "nothing was measured in" in caplog.text
    built = write_views(scene, tmp_path / "built", "clean")
    found, exact = view_depth(built.views[4], built.points), depth(built.views[4].camera)
    assert np.abs(found - exact)[exact < 4.9].max() < 1e-5
    assert np.median(np.abs(found / exact - 1)[exact > 5]) < 0.05
    assert np.isfinite(found).all()
