import json
import shutil

import numpy as np
import pycolmap
import pytest
from captures import capture
from distorted import LENS, arc, colmap_capture, colours, photograph, write_model, write_photographs
from refusals import assert_refused

from hydroviews.formats.colmap import reliable
from hydroviews.formats.colmap_format import SparsePoints
from hydroviews.formats.read import read_scene
from hydroviews.scene.lenses import Lens


@pytest.mark.parametrize("text", [False, True], ids=["binary", "text"])
def test_reads_views_points_and_split(tmp_path, text):
    scene = read_scene(colmap_capture(tmp_path / "ring", text=text))
    assert scene.name == "ring"
    assert [view.name for view in scene.views] == [f"view{i:02d}" for i in range(9)]
    assert scene.split.test == ("view00", "view08")
    assert scene.notes == ("cameras from sparse/0: 9 of 9 images registered",)
    for view, pose in zip(scene.views, arc(9), strict=True):
        assert view.lens == LENS
        np.testing.assert_allclose(view.camera.world_to_camera, pose, atol=1e-12)
    camera = scene.views[0].camera
    assert (camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy) == tuple(LENS.pinhole())
    np.testing.assert_allclose(scene.points.positions[:, 0], 0.1 * np.arange(10))
    assert scene.points.colours[3].tolist() == [3, 100, 255]
    assert np.abs(scene.views[0].image() - LENS.undistort(photograph(LENS))).max() < 1 / 255
    assert scene.resized(40).views[0].image().shape == (29, 40, 3)  # of 98x72


def test_largest_of_several_models_is_taken_and_unregistered_photographs_are_counted(tmp_path):
    folder = colmap_capture(tmp_path)
    (folder / "sparse" / "0").rename(folder / "sparse" / "1")
    write_model(folder / "sparse" / "0", ["view00.png", "view01.png"])
    write_photographs(folder / "images", ["view09.png", "view10.png"])
    scene = read_scene(folder)
    assert len(scene.views) == 9
    assert scene.notes == (
        "cameras from sparse/1: 9 of 11 images registered",
        "the largest of several models; not used: sparse/0 (2 images)",
    )


@pytest.mark.parametrize("place", ["sparse", "colmap/sparse/0", "."])
def test_models_in_other_places_are_found(tmp_path, place):
    model = (colmap_capture(tmp_path) / "sparse").rename(tmp_path / "moved") / "0"
    (tmp_path / place).mkdir(parents=True, exist_ok=True)
    for file in model.iterdir():
        file.rename(tmp_path / place / file.name)
    assert len(read_scene(tmp_path).views) == 9


def test_smaller_photographs_in_another_format(tmp_path):
    half = Lens("OPENCV", 48, 36, tuple(np.array(LENS.params) * ([0.5] * 4 + [1] * 4)))
    write_photographs(tmp_path / "images_2", [f"view{i}.png" for i in range(3)], half)
    write_model(tmp_path / "sparse" / "0", [f"view{i}.JPG" for i in range(3)])
    view = read_scene(tmp_path).views[0]
    assert view.path.name == "view0.png"
    pinhole, whole = LENS.pinhole((48, 36)), LENS.pinhole()
    assert (view.camera.width, view.camera.height) == pinhole[:2]
    assert pinhole.fx / pinhole.width == pytest.approx(whole.fx / whole.width)
    x, y = np.meshgrid(np.arange(pinhole.width) + 0.5, np.arange(pinhole.height) + 0.5)
    expected = colours(np.stack([(x - pinhole.cx) / pinhole.fx, (y - pinhole.cy) / pinhole.fy], axis=-1))
    assert np.abs(view.image() - expected)[1:-1, 1:-1].max() < 0.03


def test_split_of_a_built_scene_and_of_its_variants(tmp_path):
    scene = colmap_capture(tmp_path / "scene")
    (scene / "images").rename(scene / "clean")
    shutil.copytree(scene / "clean", scene / "streak-0" / "images")
    (scene / "streak-0" / "sparse").symlink_to("../sparse")
    for train in (["view01", "view02"], ["view02", "view01"]):  # in order of names, however it was written
        (scene / "split.json").write_text(json.dumps({"train": train, "test": ["view05"]}))
        for folder in (scene, scene / "streak-0"):
            read = read_scene(folder)
            assert (read.split.train, read.split.test) == (("view01", "view02"), ("view05",))
            assert read.views[0].path.parent == folder / ("clean" if folder == scene else "images")
    (scene / "split.json").write_text("[]")
    assert_refused(scene, r"split\.json: not a split")


def test_photographs_in_folders_keep_apart(tmp_path):
    names = [f"{camera}/{i}.png" for camera in ("left", "right") for i in range(3)]
    write_photographs(tmp_path / "images", names)
    write_model(tmp_path / "sparse" / "0", names)
    expected = [f"{camera}_{i}" for camera in ("left", "right") for i in range(3)]
    assert [view.name for view in read_scene(tmp_path).views] == expected


def test_missing_image(tmp_path):
    (colmap_capture(tmp_path) / "images" / "view03.png").unlink()
    assert_refused(tmp_path, r"1 of its 9 images are not in .*images\n.*no view03\.png\n.*copy")


def test_a_link_to_a_photograph_that_was_moved(tmp_path):
    folder = colmap_capture(tmp_path / "capture", count=3)
    link = folder / "images" / "view01.png"
    link.rename(tmp_path / "moved.png")
    link.symlink_to(tmp_path / "before.png")
    assert_refused(folder, rf"{link}: a link to .*\n  found: {tmp_path}/before\.png\n.*`poses`")


@pytest.mark.parametrize(
    ("photographs", "model", "message"),
    [
        ((), (), "neither cameras nor photographs"),
        (("a.png",), (), r"1 photographs and no camera file\n.*\n.*hydroviews poses"),
        ((), ("a.png",), "no photographs beside the cameras"),
        (("a.png", "b.png", "c.png"), ("x.png", "y.png", "z.png"), "a camera file for other images"),
        (("a.png", "b.png", "c.png"), None, r"no registered image\n.*hydroviews poses"),
        (("a.png", "b.png"), ("a.png", "b.png"), r"too few views\n.*1 to train on, 1 held out"),
    ],
    ids=["nothing", "no cameras", "no photographs", "others", "no image", "two"],
)
def test_folders_without_a_scene(tmp_path, photographs, model, message):
    write_photographs(tmp_path / "images", photographs)
    if model != ():
        write_model(tmp_path / "sparse" / "0", model or [])
    assert_refused(tmp_path, message)
    assert_refused(tmp_path / "nowhere", "no such folder")


@pytest.mark.parametrize("file", ["cameras", "images", "points3D"])
@pytest.mark.parametrize("share", [0.0, 0.05, 0.5, 0.99, 1.01])
def test_binary_models_cut_short_or_too_long(tmp_path, file, share):
    path = colmap_capture(tmp_path) / "sparse" / "0" / f"{file}.bin"
    content = path.read_bytes()
    path.write_bytes(content[: int(len(content) * share)] if share < 1 else content + b"rest")
    assert_refused(tmp_path, rf"{file}\.bin: damaged or cut short\n.*(bytes|records end)")


@pytest.mark.parametrize("file", ["cameras", "images", "points3D"])
def test_text_models_cut_short(tmp_path, file):
    path = colmap_capture(tmp_path, text=True) / "sparse" / "0" / f"{file}.txt"
    before, _, last = path.read_text().rstrip().rpartition("\n")
    path.write_text(f"{before}\n{last[: len(last) // 3]}")
    assert_refused(tmp_path, rf"{file}\.txt")


def test_images_of_a_camera_that_is_not_there(tmp_path):
    path = colmap_capture(tmp_path, text=True) / "sparse" / "0" / "cameras.txt"
    path.write_text(path.read_text().replace("\n1 OPENCV", "\n7 OPENCV"))
    assert_refused(tmp_path, r"names cameras that cameras\.\* lacks\n.*camera 1\n.*\[7\]")


def n_reliable(errors, tracks):
    places = np.zeros((len(errors), 3))
    return len(reliable(SparsePoints(places, places.astype(np.uint8), errors, tracks)))


@pytest.mark.parametrize("count", [300, 3000])
@pytest.mark.parametrize(("error", "track"), [(5.0, 3), (0.5, 2)], ids=["far off", "seen by two"])
def test_points_that_cannot_be_relied_on_are_left_out(count, error, track):
    bad = np.arange(count) % 3 == 0
    assert n_reliable(np.where(bad, error, 0.5), np.where(bad, track, 3)) == count * 2 / 3
    assert n_reliable(np.where(np.arange(9) == 0, 0.5, 5.0), np.full(9, 4)) == 9  # too few otherwise: all are taken


def test_bonsai_flags_exactly_the_misplaced_cameras():
    scene = read_scene(capture("mipnerf360_bonsai"))
    registered, far = scene.notes
    assert registered == "cameras from sparse/0: 292 of 292 images registered"
    assert far.startswith("DSCF5644, DSCF5645: more than 10 median steps away")
    assert len(scene.points) == 17157
    assert len(scene.split.test) == 37


@pytest.mark.parametrize("name", ["llff_flower", "mipnerf360_bonsai"])
def test_points_project_to_their_keypoints_after_undistortion(name):
    folder = capture(name)
    scene = read_scene(folder)
    model = pycolmap.Reconstruction(folder / "sparse" / "0")
    by_name = {image.name.rsplit(".")[0]: image for image in model.images.values()}
    for view in scene.views[:: len(scene.views) // 10]:
        seen = [p for p in by_name[view.name].points2D if p.has_point3D()]
        rays = view.lens.colmap().cam_from_img(np.array([p.xy for p in seen]))
        camera = view.camera
        observed = rays * (camera.fx, camera.fy) + (camera.cx, camera.cy)
        pixels, depths = camera.project([model.points3D[p.point3D_id].xyz for p in seen])
        assert (depths > 0).all()
        assert np.median(np.linalg.norm(pixels - observed, axis=1)) < 1
