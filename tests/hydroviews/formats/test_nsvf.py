import numpy as np
import pytest
from refusals import assert_refused
from synthetic import capture_in

from hydroviews.formats.read import read_scene


@pytest.fixture
def scene(tmp_path):
    """The files of the folder in NSVF's layout."""
    scene = capture_in(tmp_path)
    (tmp_path / "images").rename(tmp_path / "rgb")
    (tmp_path / "pose").mkdir()
    for view in scene.views:
        np.savetxt(tmp_path / "pose" / f"{view.name}.txt", np.linalg.inv(view.camera.world_to_camera))
    matrix = np.eye(4)
    matrix[:3, :3] = scene.views[0].camera.matrix
    np.savetxt(tmp_path / "intrinsics.txt", matrix)
    return scene


@pytest.mark.parametrize("short", [False, True])
def test_cameras_are_the_ones_written(scene, tmp_path, short):
    if short:  # the form of the synthetic scenes: f cx cy, then other things
        camera = scene.views[0].camera
        text = f"{camera.fx} {camera.cx} {camera.cy} 0.\n0. 0. 0.\n0.\n1.\n{camera.height} {camera.width}\n"
        (tmp_path / "intrinsics.txt").write_text(text)
    read = read_scene(tmp_path)
    assert read.split == scene.split
    for ours, given in zip(read.views, scene.views, strict=True):
        assert ours.name == given.name
        assert np.allclose(ours.camera.world_to_camera, given.camera.world_to_camera, atol=1e-9)
        assert np.allclose(ours.camera.matrix, given.camera.matrix)


def test_the_matrix_may_have_two_focal_lengths(scene, tmp_path):
    matrix = np.loadtxt(tmp_path / "intrinsics.txt")
    matrix[1, 1] *= 1.1
    np.savetxt(tmp_path / "intrinsics.txt", matrix)
    assert np.allclose(read_scene(tmp_path).views[0].camera.matrix, matrix[:3, :3])


@pytest.mark.parametrize(
    ("file", "content", "message"),
    [
        ("pose/view-03.txt", None, "1 of 9 photographs have no pose\n.*view-03.txt"),
        ("pose/view-03.txt", "1 0 0 0\n0 1 0 0\n0 0 1", "not a pose"),
        ("pose/view-03.txt", "1 0 0 0\n0 1 0 0\n0 0 2 0\n0 0 0 1", "not rigid"),
        ("pose/view-03.txt", "nothing", "not numbers"),
        ("intrinsics.txt", "0 0 0\n", "impossible focal length"),
        ("intrinsics.txt", "", "no focal length"),
    ],
)
def test_damage_is_told(scene, tmp_path, file, content, message):
    (tmp_path / file).unlink()
    if content is not None:
        (tmp_path / file).write_text(content)
    assert_refused(tmp_path, message)
