import io

import numpy as np
import pytest
from captures import capture
from distorted import arc, write_photographs
from in_the_way import KINDS, not_for_ever, swap
from refusals import assert_refused

from hydroviews.formats.read import read_scene
from hydroviews.scene.camera_errors import angles, pair_errors
from hydroviews.scene.lenses import Lens


def table(count, size=(96, 72), focal=80.0):
    """Rows for the cameras of `arc`: columns down, right, backward, position, (height, width, focal)."""
    rows = []
    for pose in arc(count):
        to_world = np.linalg.inv(pose)
        right, down, forward, position = to_world[:3].T
        matrix = np.stack([down, right, -forward, position, [size[1], size[0], focal]], axis=1)
        rows.append([*matrix.ravel(), 1.0, 10.0])
    return np.array(rows)


def write_capture(folder, rows):
    pinhole = Lens("PINHOLE", 96, 72, (80, 80, 48, 36))
    write_photographs(folder / "images", [f"{i:02d}.png" for i in range(4)], pinhole)
    np.save(folder / "poses_bounds.npy", rows)
    return folder


@pytest.mark.parametrize("factor", [1, 4])
def test_poses_and_focal_length(tmp_path, factor):
    scene = read_scene(write_capture(tmp_path, table(4, (96 * factor, 72 * factor), 80.0 * factor)))
    for view, pose in zip(scene.views, arc(4), strict=True):
        np.testing.assert_allclose(view.camera.world_to_camera, pose, atol=1e-12)
    camera = scene.views[0].camera
    assert (camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy) == (96, 72, 80, 80, 48, 36)
    assert scene.notes[0] == "cameras from poses_bounds.npy: 4 images"


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (table(5), r"other images\n.*5 cameras, 4 images"),
        (table(4)[:, :15], "not an LLFF camera file"),
        (table(4, size=(100, 72)), r"differ in size\n.*96x72 pixels\n.*100x72"),
        (np.full((4, 17), np.nan), "bad heights, widths or focal lengths"),
        (np.tile(np.r_[np.zeros(4), 72, np.zeros(4), 96, np.zeros(4), 80, 1, 9], (4, 1)), "not rigid"),
    ],
)
def test_bad_files(tmp_path, rows, message):
    assert_refused(write_capture(tmp_path, rows), message)


def array_file(header: bytes) -> bytes:
    """An array of four rows of 17 numbers under a header of one's own."""
    header = header.ljust(127) + b"\n"
    return b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header + bytes(4 * 17 * 8)


def array_of_shape(shape: str) -> bytes:
    return array_file(f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}".encode())


def archive_of(values) -> bytes:
    content = io.BytesIO()
    np.savez(content, poses=values)
    return content.getvalue()


SHAPES = ("(-4, 17)", "(4, -17)", f"({'9' * 20}, 17)", f"({2**62}, 17)", "(4,", "(4, 1700000000000)")
NO_ARRAYS = {
    **{f"cut after {length}": array_file(b"")[:length] for length in (0, 20)},
    **{f"shape {shape}": array_of_shape(shape) for shape in SHAPES},
    "cut short": array_of_shape("(4, 17)")[:300],
    "no dictionary": array_file(b"{-1escr': '<f8', 'fortran_order': False, 'shape': -1, 17), }"),
    "another dictionary": array_file(b"{9: 0}"),
    "indented": array_file(b"  {\n1"),
    "brackets": array_file(b"(" * 100),
    "an archive": archive_of(np.zeros((4, 17))),
    "an archive of code": archive_of(np.array([print], object)),
}


@pytest.mark.parametrize("content", NO_ARRAYS.values(), ids=NO_ARRAYS)
def test_files_that_are_no_arrays(tmp_path, content):
    folder = write_capture(tmp_path, table(4))
    (folder / "poses_bounds.npy").write_bytes(content)
    assert_refused(folder, r"poses_bounds\.npy: not ")


def test_flower_poses_agree_with_its_colmap_model(tmp_path):
    folder = capture("llff_flower")
    solved = read_scene(folder)
    assert solved.notes[0].startswith("cameras from sparse/0")  # preferred where both are there
    (tmp_path / "images").symlink_to(folder / "images")
    (tmp_path / "poses_bounds.npy").write_bytes((folder / "poses_bounds.npy").read_bytes())
    scene = read_scene(tmp_path)
    assert len(scene.views) == 34
    camera = scene.views[0].camera
    assert (camera.width, camera.height) == (800, 600)
    assert camera.fx == pytest.approx(3575.06 * 800 / 4032, rel=1e-4)
    # The world differs by a similarity; rotations between views do not.
    for pair in ((0, 33), (5, 20), (12, 30)):
        poses = [np.array([s.views[i].camera.world_to_camera for i in pair]) for s in (scene, solved)]
        turns = [second[:3, :3] @ first[:3, :3].T for first, second in poses]
        assert angles(turns[0].T @ turns[1]) < 0.5
        assert pair_errors(*poses) < 1  # of the direction to the second as well


@pytest.mark.parametrize("kind", KINDS)
def test_something_else_where_the_file_belongs(tmp_path, kind):
    swap(write_capture(tmp_path, table(4)) / "poses_bounds.npy", kind)
    with not_for_ever():
        assert_refused(tmp_path, r"poses_bounds\.npy: not a file")
