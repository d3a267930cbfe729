"""Captures from strangers: what is impossible is refused by name or left out and told, in every format alike."""

import json
import math
import shutil

import numpy as np
import PIL.Image
import pytest
from refusals import assert_refused
from strangers import FORMATS, WITH_NAMES, Stranger, write

from hydroviews.errors import InputError
from hydroviews.formats.read import read_scene
from hydroviews.scene.checks import FARTHEST

pytestmark = pytest.mark.filterwarnings("error")

every_format = pytest.mark.parametrize("kind", FORMATS)
COLMAP = FORMATS[:2]


@every_format
def test_a_possible_capture_is_read(tmp_path, kind, caplog):
    scene = read_scene(write(kind, tmp_path, Stranger(distance=5.0)))
    assert [view.name for view in scene.views] == ["0", "1", "2", "3"]
    assert scene.views[2].camera.centre == pytest.approx([5, 0, 0])
    assert len(scene.points) == (2 if kind in WITH_NAMES else 0)
    assert not caplog.records


FOCAL = r"(cameras|transforms|poses_bounds|intrinsics)\..*(\n.*)*(focal|fl_x|finite)"
FAR = r"\b2(\.png|\.txt: 2)?: (the camera is impossibly far|the pose has numbers)"
IMPOSSIBLE = [  # the formats, what the capture says, the values, the error
    (FORMATS, "focal", [0.0, -700.0, 1e-9, 1e308, math.inf, math.nan], FOCAL),
    # NSVF takes the photographs' sizes.
    (
        FORMATS[:4],
        "size",
        [(0, 72), (-450, -800), (1e30, 1e30), (96, 40000), (30000, 30000)],
        "impossible size|damaged",
    ),
    (FORMATS, "distance", [1e300, -2 * FARTHEST, math.inf, math.nan], FAR),
    (COLMAP, "camera_ids", [(1, 1)], r"cameras\..*: camera 1 is listed twice"),
    (COLMAP, "image_ids", [(1, 2, 2, 3)], r"images\..*: image 2 is listed twice"),
    (COLMAP, "point_ids", [(7, 7)], r"points3D\..*: point 7 is listed twice"),
    (WITH_NAMES, "name", ["../../secret.png", "a/../../../secret.png"], "leads out of the capture"),
    (COLMAP, "name", ["{outside}/secret.png"], "leads out of the capture"),
    (WITH_NAMES, "name", ["a" * 5000, "b/" * 600], "too long"),
    (WITH_NAMES, "name", ["caf\udce9.png"], "not UTF-8|not valid JSON"),  # latin-1; half a surrogate pair in JSON
]


@pytest.mark.parametrize(
    ("kind", "field", "value", "message"),
    [
        pytest.param(kind, field, value, message, id=f"{kind}-{field}-{value!a:.30}")
        for kinds, field, values, message in IMPOSSIBLE
        for kind in kinds
        for value in values
    ],
)
def test_what_is_impossible_is_refused(tmp_path, kind, field, value, message):
    if field == "name":
        value = value.replace("{outside}", str(tmp_path))
    PIL.Image.new("RGB", (96, 72)).save(tmp_path / "secret.png")
    assert_refused(write(kind, tmp_path / "capture", Stranger(**{field: value})), message)


@pytest.mark.parametrize(
    ("kind", "model", "distortion"),
    [
        ("nerfstudio", "OPENCV", (-5.0, 0.0, 0.0, 0.0)),
        ("nerfstudio", "OPENCV_FISHEYE", (-0.5, 0.0, 0.0, 0.0)),
        ("colmap text", "FULL_OPENCV", (-3.0, *[0.0] * 7)),
        ("colmap binary", "OPENCV", (0.0, 0.0, 0.5, 0.5)),
        ("colmap binary", "OPENCV", (-5000.0, 0.0, 0.0, 0.0)),  # turned over beyond the fold: upright nowhere
        ("colmap text", "THIN_PRISM_FISHEYE", (-0.5, *[0.0] * 7)),
        ("colmap text", "OPENCV", (5e5, 0.0, 0.0, 0.0)),
        ("colmap text", "OPENCV", (1e308, 0.0, 0.0, 0.0)),
    ],
)
def test_distortion_that_folds_inside_the_picture(tmp_path, kind, model, distortion):
    with pytest.raises(InputError, match=r"0\.png: .* its distortion (folds inside|leads outside) the picture"):
        read_scene(write(kind, tmp_path, Stranger(model=model, distortion=distortion)))


@pytest.mark.parametrize("kind", WITH_NAMES)
@pytest.mark.parametrize("wrong", [math.nan, math.inf, 1e308, -2 * FARTHEST])
def test_impossible_points_are_left_out_and_told(tmp_path, kind, wrong, caplog):
    points = [(0.0, 0.0, 0.2, 1, 2, 3), (0.1, wrong, 0.2, 4, 5, 6)]
    scene = read_scene(write(kind, tmp_path, Stranger(points=points)))
    assert scene.points.positions.tolist() == [[0, 0, 0.2]]
    assert scene.points.colours.tolist() == [[1, 2, 3]]
    assert "1 of 2 points left out: NaN, infinite, or more than 1e+09 units" in caplog.text


@pytest.mark.parametrize("kind", ["colmap text", "nerfstudio"])  # binary models have bytes
def test_impossible_colours(tmp_path, kind):
    points = [(0.0, 0.0, 0.2, 1, 2, 3), (0.1, 0.0, 0.2, 300, 5, 6)]
    with pytest.raises(InputError, match=r"points.*: 1 of 2 points have impossible colours\n  found: \[300"):
        read_scene(write(kind, tmp_path, Stranger(points=points)))


@every_format
def test_a_name_that_leaves_no_room_for_suffixes(tmp_path, kind):
    stem = "n" * 246
    folder = write(kind, tmp_path, Stranger(name=f"{stem}.png"))
    pictures = folder / ("rgb" if kind == "nsvf" else "images")
    (pictures / "2.png").rename(pictures / f"{stem}.png")
    if kind == "nsvf":
        (folder / "pose" / "2.txt").rename(folder / "pose" / f"{stem}.txt")
    assert_refused(folder, r"a name that is too long\n  found: 246 bytes.*\n.*150\n.*rename")


def test_a_model_of_two(tmp_path):
    write("colmap text", tmp_path, Stranger())
    write("colmap binary", tmp_path / "other", Stranger())
    (tmp_path / "sparse/0/images.txt").unlink()
    (tmp_path / "other/sparse/0/images.bin").rename(tmp_path / "sparse/0/images.bin")
    assert_refused(tmp_path, r"one file is binary and one is text\n  found: cameras\.txt and images\.bin")


@pytest.mark.parametrize("suffix", [".gif", ".exr", ".hdr", ".gpr", ".insp", ".tga", ".psd"])
@pytest.mark.parametrize(
    ("cameras", "message"), [(True, "no photographs beside the cameras"), (False, "no cameras")], ids=["model", "none"]
)
def test_photographs_that_are_not_read_are_named(tmp_path, cameras, message, suffix):
    write("colmap text", tmp_path, Stranger())
    shutil.rmtree(tmp_path / "images")
    (tmp_path / "images" / "more").mkdir(parents=True)
    for name in ("a", "more/a"):
        (tmp_path / "images" / f"{name}{suffix}").write_bytes(b"GIF89a" if suffix == ".gif" else b"something else")
    if not cameras:
        (tmp_path / "sparse" / "0" / "images.txt").unlink()
    assert_refused(tmp_path, f"{message}\n  found: 2 {suffix}, which are not read")


@pytest.mark.parametrize(
    ("frame", "values", "message"),
    [
        (None, {"ply_file_path": 7}, "ply_file_path: not a file name"),
        (None, {"ply_file_path": "/etc/passwd"}, "leads out of the capture"),
        (None, {"ply_file_path": "../points.ply"}, "leads out of the capture"),
        (None, {"w": int("9" * 400)}, "not valid JSON\n  found: an integer of 400 digits"),
        (None, {"w": 1e300}, "impossible size"),
        *((None, {"fl_x": odd}, "fl_x is not a number") for odd in ("long", [1])),
        *((None, {"frames": odd}, "no frames") for odd in ({"0": 1}, [3], [])),
        (None, {"fl_x": None, "fl_y": None}, "no focal length"),
        (None, {"k4": 0.1}, "fourth radial coefficient"),
        (None, {"camera_model": "EQUIRECTANGULAR"}, "EQUIRECTANGULAR is not supported"),
        (None, {"w": 100}, "image and camera differ in size"),
        *(
            (None, {"fl_x": None, "fl_y": None, "camera_angle_x": angle}, "0: impossible camera_angle_x")
            for angle in (0.0, -1.0, 4.0)
        ),
        (1, {"file_path": "/etc/passwd"}, "frame 1: a name that leads out of the capture"),
        (1, {"file_path": "images/\0.png"}, "frame 1: not a file name"),
        (1, {"file_path": 1}, "frame 1 is not complete"),
        (1, {"mask_path": ["a"]}, "mask_path: not a file name"),
        (1, {"mask_path": "../mask.png"}, "mask_path: a name that leads out of the capture"),
        (1, {"transform_matrix": [[10**299, i, 0, 0] for i in range(4)]}, "1: the pose is not rigid"),
        (1, {"transform_matrix": [[1e308, 1e308, 1e308, 0.0]] * 4}, "1: the pose is not rigid"),
        (1, {"transform_matrix": None}, "frame 1 is not complete"),
        (1, {"transform_matrix": {"a": 1}}, "1: the pose is not a matrix of numbers"),
        (1, {"transform_matrix": np.full((4, 4), math.nan).tolist()}, "1: the pose has numbers that are not finite"),
        (1, {"transform_matrix": np.diag([0.0, 0, 0, 1]).tolist()}, "1: the pose is not rigid"),
        (1, {"transform_matrix": np.diag([-1.0, 1, 1, 1]).tolist()}, "1: the pose is not rigid"),  # mirrored
    ],
)
def test_odd_values_of_transforms_json(tmp_path, frame, values, message):
    """The values are the file's or a frame's; None takes one out."""
    path = write("nerfstudio", tmp_path, Stranger()) / "transforms.json"
    content = json.loads(path.read_text())
    changed = content if frame is None else content["frames"][frame]
    changed |= values
    for name in [name for name, value in values.items() if value is None]:
        del changed[name]
    path.write_text(json.dumps(content))
    assert_refused(tmp_path, message)
