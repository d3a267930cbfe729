import json
import math
from pathlib import Path

import numpy as np
import pytest
from distorted import LENS, arc, write_photographs
from plyfile import PlyData, PlyElement
from refusals import assert_refused

from hydroviews.formats.read import read_scene
from hydroviews.scene.masks import write_ignored

TO_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])
SHARED = dict(zip(("fl_x", "fl_y", "cx", "cy", "k1", "k2", "p1", "p2", "w", "h"), (*LENS.params, 96, 72), strict=True))


def frames(count=4, suffix=".png"):
    return [
        {"file_path": f"./images/{i:02d}{suffix}", "transform_matrix": (np.linalg.inv(pose) @ TO_OPENGL).tolist()}
        for i, pose in enumerate(arc(count))
    ]


def write_capture(folder: Path, content: dict, count: int = 4) -> Path:
    write_photographs(folder / "images", [f"{i:02d}.png" for i in range(count)])
    (folder / "transforms.json").write_text(json.dumps(content))
    return folder


def test_opengl_poses_and_shared_intrinsics(tmp_path):
    scene = read_scene(write_capture(tmp_path, {**SHARED, "frames": frames()}))
    assert [view.name for view in scene.views] == ["00", "01", "02", "03"]
    assert scene.views[0].lens == LENS
    for view, pose in zip(scene.views, arc(4), strict=True):
        np.testing.assert_allclose(view.camera.world_to_camera, pose, atol=1e-12)
    assert scene.notes == ("cameras from transforms.json: 4 of 4 frames have an image", "the capture has no points")


def test_intrinsics_of_a_frame_win(tmp_path):
    own = frames()
    own[1].update(fl_x=100.0, k1=0.0, k2=0.0, p1=0.0, p2=0.0)
    scene = read_scene(write_capture(tmp_path, {**SHARED, "frames": own}))
    assert scene.views[0].lens == LENS
    assert scene.views[1].lens is None
    assert scene.views[1].camera.fx == 100.0


def test_field_of_view_alone_and_names_without_suffix(tmp_path):
    angle = 2 * math.atan(48 / 80)
    scene = read_scene(write_capture(tmp_path, {"camera_angle_x": angle, "frames": frames(suffix="")}))
    camera = scene.views[0].camera
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == pytest.approx((80, 80, 48, 36))
    assert scene.views[0].path.name == "00.png"


@pytest.mark.parametrize(
    ("given", "model", "distortion"),
    [
        ({}, None, None),
        ({"camera_model": "PINHOLE"}, None, None),
        ({"camera_model": "OPENCV", "k1": 0.1, "p2": 0.01}, "OPENCV", (0.1, 0, 0, 0.01)),
        ({"k1": 0.1, "k3": 0.01}, "FULL_OPENCV", (0.1, 0, 0, 0, 0.01, 0, 0, 0)),
        ({"camera_model": "OPENCV_FISHEYE", "k1": 0.1, "k4": 0.01}, "OPENCV_FISHEYE", (0.1, 0, 0, 0.01)),
        ({"is_fisheye": True}, "OPENCV_FISHEYE", (0, 0, 0, 0)),
    ],
)
def test_camera_models(tmp_path, given, model, distortion):
    scene = read_scene(write_capture(tmp_path, {"fl_x": 80.0, **given, "frames": frames()}))
    lens = scene.views[0].lens
    assert (lens and lens.model) == model
    if lens:
        assert lens.params == (80, 80, 48, 36, *distortion)
        assert scene.views[0].image().shape[2] == 3


def test_missing_frames_are_noted(tmp_path):
    scene = read_scene(write_capture(tmp_path, {**SHARED, "frames": frames(6)}))
    assert len(scene.views) == 4
    assert "4 of 6 frames" in scene.notes[0]
    assert scene.notes[1] == "no image for images/04.png, images/05.png"


@pytest.mark.parametrize("masks", ["00.png.png", "00.png", "images/00.png.png"])
@pytest.mark.parametrize("suffix", ["", ".png", ".jpg"])
def test_masks_by_the_file_or_by_the_frame(tmp_path, masks, suffix):
    write_capture(tmp_path, {**SHARED, "frames": frames(suffix=suffix)})
    write_ignored(tmp_path / "masks" / masks, np.ones((72, 96), bool))
    assert [view.mask is not None for view in read_scene(tmp_path).views] == [True, False, False, False]


def test_masks_of_several_cameras_whose_photographs_share_names(tmp_path):
    paths = [f"images/cam{i % 2}/{i // 2}.png" for i in range(4)]
    write_photographs(tmp_path, paths)
    own = [{**frame, "file_path": path} for frame, path in zip(frames(), paths, strict=True)]
    (tmp_path / "transforms.json").write_text(json.dumps({**SHARED, "frames": own}))
    write_ignored(tmp_path / "masks" / "0.png.png", np.ones((72, 96), bool))  # of which camera?
    scene = read_scene(tmp_path)
    assert not any(view.mask for view in scene.views)
    assert scene.notes[-1] == "no masks: of 1 pictures in masks none is named as it should be, such as cam0/0.png.png"
    write_ignored(tmp_path / "masks" / "cam1" / "0.png.png", np.ones((72, 96), bool))
    assert [view.mask is not None for view in read_scene(tmp_path).views] == [False, False, True, False]


def test_points_of_a_ply_file(tmp_path):
    columns = [*((axis, "f4") for axis in "xyz"), *((colour, "u1") for colour in ("red", "green", "blue"))]
    vertices = np.array([(1, 2, 3, 10, 20, 30)], columns)
    path = tmp_path / "points.ply"
    PlyData([PlyElement.describe(vertices, "vertex")]).write(path)
    content = {**SHARED, "ply_file_path": "points.ply", "applied_transform": np.eye(4)[:3].tolist(), "frames": frames()}
    points = read_scene(write_capture(tmp_path, content)).points
    assert (points.positions.tolist(), points.colours.tolist()) == ([[1, 2, 3]], [[10, 20, 30]])
    path.write_bytes(b"no ply")
    assert_refused(tmp_path, r"points\.ply: not a point cloud")
    path.unlink()
    assert_refused(tmp_path, r"points\.ply: no such file")


def test_rotation_off_by_rounding_is_made_rigid(tmp_path):
    own = frames()
    own[2]["transform_matrix"] = (np.array(own[2]["transform_matrix"]) * [[1.005] * 3 + [1.0]]).tolist()
    pose = read_scene(write_capture(tmp_path, {**SHARED, "frames": own})).views[2].camera.rotation
    np.testing.assert_allclose(pose @ pose.T, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(pose, arc(4)[2][:3, :3], atol=1e-12)


def test_a_file_without_frames(tmp_path):
    assert_refused(write_capture(tmp_path, []), "no frames")
