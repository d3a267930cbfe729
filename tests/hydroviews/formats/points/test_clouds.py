from dataclasses import replace

import numpy as np
import pytest
from painted_room import points_on_walls, scene_in_room, write_room
from plyfile import PlyData, PlyElement

from hydroviews.dataset import clean_views
from hydroviews.dataset.clean_views import write_cameras
from hydroviews.formats.points.doubles import without_doubles
from hydroviews.formats.points.ply import read_ply
from hydroviews.formats.read import read_scene
from hydroviews.formats.writers import write_colmap
from hydroviews.scene.scenes import Points

CLOUD = points_on_walls()


def taken(points, rows):
    return Points(points.positions[rows], points.colours[rows])


@pytest.mark.parametrize("times", [2, 5])
@pytest.mark.parametrize("origin", [0.0, 1e4])
def test_points_that_stand_in_a_cloud_several_times_are_taken_once(times, origin):
    rows = np.tile(np.arange(400), times)
    moved = Points(CLOUD.positions + origin, CLOUD.colours)
    jitter = np.random.default_rng(0).normal(0, 1e-8, (len(rows), 3))  # as of another precision
    found = without_doubles(Points(moved.positions[rows] + jitter, moved.colours[rows]))
    assert len(found) == 400
    assert np.abs(found.positions - moved.positions).max() < 1e-6
    assert np.array_equal(found.colours, moved.colours)


def test_a_cloud_with_few_doubles_stays_as_it_is():
    rows = np.r_[np.arange(400), np.arange(20)]
    assert len(without_doubles(taken(CLOUD, rows))) == 420
    assert without_doubles(CLOUD) is CLOUD
    for count in (0, 1, 2):
        assert len(without_doubles(taken(CLOUD, np.arange(count)))) == count
    assert len(without_doubles(taken(CLOUD, np.zeros(9, int)))) == 9  # of no size


def test_doubles_are_told(tmp_path, caplog):
    scene = scene_in_room(tmp_path / "walk")
    doubled = replace(scene, points=taken(CLOUD, np.repeat(np.arange(400), 5)))
    read = read_scene(write_room(doubled, tmp_path / "walk", "nerfstudio"))
    assert len(read.points) == 400
    assert "1600 of 2000 points are doubles, in the places of others, and left out" in read.notes
    assert "1600 of 2000 points are doubles" in caplog.text


@pytest.mark.parametrize(
    ("names", "change"),
    [
        *((names, np.copy) for names in ("r g b", "Red Green Blue", "diffuse_red diffuse_green diffuse_blue")),
        ("f_dc_0 f_dc_1 f_dc_2", lambda colours: np.float32((colours / 255 - 0.5) * 2 * np.sqrt(np.pi))),  # Gaussians
    ],
)
def test_colours_under_other_names_are_read(tmp_path, names, change, caplog):
    names = [*names.split(), *("XYZ" if names.istitle() else "xyz")]
    columns = [*change(CLOUD.colours).T, *CLOUD.positions.T]
    vertices = np.rec.fromarrays(columns, names=names)
    PlyData([PlyElement.describe(vertices, "vertex")]).write(tmp_path / "cloud.ply")
    found = read_ply(tmp_path / "cloud.ply")
    assert np.array_equal(found.positions, CLOUD.positions)
    assert np.array_equal(found.colours, CLOUD.colours)
    assert caplog.text == ""


def test_a_cloud_without_colours_is_grey_and_told(tmp_path, caplog):
    vertices = np.zeros(5, [*((axis, "f4") for axis in "xyz"), ("intensity", "f4")])
    PlyData([PlyElement.describe(vertices, "vertex")]).write(tmp_path / "cloud.ply")
    assert (read_ply(tmp_path / "cloud.ply").colours == 128).all()
    assert "no colours, so that its points are grey; found x, y, z, intensity, expected red, green, blue" in caplog.text


@pytest.mark.parametrize(("found", "taken_over"), [(200, True), (20, False)])
def test_a_few_points_are_no_better_than_none(tmp_path, monkeypatch, found, taken_over):
    """Of 30 points, training begins with random ones; those triangulated from the photographs are better."""
    scene = replace(scene_in_room(tmp_path / "walk"), points=taken(CLOUD, np.arange(30)))
    monkeypatch.setattr(clean_views, "triangulate", lambda *_: taken(CLOUD, np.arange(found)))
    written = write_cameras(scene, tmp_path / "built", scene, "clean")
    assert len(written.points) == (found if taken_over else 30)
    said = "200 points triangulated from the photographs instead of 30, which are too few to begin with"
    assert (said in written.notes) == taken_over


def test_coordinates_of_a_country_stay_exact_in_the_written_cloud(tmp_path):
    shift = np.array([448262.137, 5411932.642, 312.411])
    far = Points(CLOUD.positions + shift, CLOUD.colours)
    write_colmap(replace(scene_in_room(tmp_path / "walk"), points=far), tmp_path / "sparse")
    vertices = PlyData.read(tmp_path / "sparse" / "points3D.ply")["vertex"].data
    written = np.stack([vertices[axis] for axis in "xyz"], axis=1)
    assert np.abs(written - far.positions).max() < 1e-8
    assert len(np.unique(written[:, 1])) > 300
