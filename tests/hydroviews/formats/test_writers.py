from dataclasses import replace

import numpy as np
import pycolmap
import pytest
from plyfile import PlyData
from synthetic import capture_in

from hydroviews.formats.colmap import read_colmap
from hydroviews.formats.nerfstudio import read_nerfstudio
from hydroviews.formats.writers import write_colmap, write_nerfstudio
from hydroviews.scene.images import write_png
from hydroviews.scene.scenes import no_points


def assert_same_cameras(scene, other):
    assert [view.name for view in scene.views] == [view.name for view in other.views]
    for view, expected in zip(scene.views, other.views, strict=True):
        camera, wanted = view.camera, expected.camera
        assert (camera.width, camera.height) == (wanted.width, wanted.height)
        np.testing.assert_array_equal(camera.matrix, wanted.matrix)
        np.testing.assert_allclose(camera.world_to_camera, wanted.world_to_camera, rtol=0, atol=1e-9)
        assert view.lens is None


@pytest.fixture
def scene(tmp_path):
    """Nine views, two of them of another size."""
    scene = capture_in(tmp_path / "ring")
    for view in scene.views[7:]:
        write_png(view.path, np.zeros((18, 24, 3), np.float32))
    small = (replace(view, camera=view.camera.resized(24, 18)) for view in scene.views[7:])
    return replace(scene, views=(*scene.views[:7], *small))


def test_colmap_round_trip(tmp_path, scene):
    write_colmap(scene, tmp_path / "ring" / "sparse" / "0")
    read = read_colmap(tmp_path / "ring", "ring")
    assert_same_cameras(read, scene)
    np.testing.assert_array_equal(read.points.positions, scene.points.positions)
    np.testing.assert_array_equal(read.points.colours, scene.points.colours)
    assert read.split == scene.split
    for view, expected in zip(read.views, scene.views, strict=True):
        np.testing.assert_array_equal(view.image(), expected.image())


def test_pycolmap_opens_it(tmp_path, scene):
    folder = tmp_path / "sparse" / "0"
    write_colmap(scene, folder)
    model = pycolmap.Reconstruction(folder)
    assert model.num_reg_images() == 9
    assert model.num_cameras() == 2
    assert {camera.model_name for camera in model.cameras.values()} == {"PINHOLE"}
    assert model.is_valid()
    point = scene.points.positions[0]
    pixel = model.find_image_with_name("view-03.png").project_point(point)
    np.testing.assert_allclose(pixel, scene.views[3].camera.project([point])[0][0], atol=1e-9)
    vertices = PlyData.read(folder / "points3D.ply")["vertex"]
    np.testing.assert_allclose(vertices["y"], scene.points.positions[:, 1], rtol=1e-6)
    np.testing.assert_array_equal(vertices["green"], scene.points.colours[:, 1])


def test_nerfstudio_round_trip(tmp_path, scene):
    write_nerfstudio(scene, tmp_path / "ring" / "transforms.json", "images")
    read = read_nerfstudio(tmp_path / "ring", "ring")
    assert_same_cameras(read, scene)
    assert len(read.points) == 0
    write_colmap(scene, tmp_path / "ring" / "sparse" / "0")
    write_nerfstudio(scene, tmp_path / "ring" / "transforms.json", "images")
    points = read_nerfstudio(tmp_path / "ring", "ring").points
    np.testing.assert_allclose(points.positions, scene.points.positions, rtol=1e-6)
    np.testing.assert_array_equal(points.colours, scene.points.colours)


def test_same_scene_same_bytes_and_old_model_replaced(tmp_path, scene):
    write_colmap(replace(scene, points=no_points()), tmp_path / "a" / "0")
    for folder in ("a", "b"):
        write_colmap(scene, tmp_path / folder / "0")
        write_nerfstudio(scene, tmp_path / folder / "transforms.json", "images")
    names = ["cameras.bin", "frames.bin", "images.bin", "points3D.bin", "points3D.ply", "rigs.bin"]
    assert sorted(p.name for p in (tmp_path / "a" / "0").iterdir()) == names
    for name in [*(f"0/{n}" for n in names), "transforms.json"]:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_failed_write_leaves_the_old_model_and_nothing_else(tmp_path, scene):
    folder = tmp_path / "sparse" / "0"
    write_colmap(scene, folder)
    before = (folder / "images.bin").read_bytes()
    damaged = replace(scene, points=replace(scene.points, colours=scene.points.colours[:5]))
    with pytest.raises(ValueError, match="zip"):
        write_colmap(damaged, folder)
    assert (folder / "images.bin").read_bytes() == before
    assert [p.name for p in folder.parent.glob("[!.]*")] == ["0"]
