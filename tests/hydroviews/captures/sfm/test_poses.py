import re
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import cv2
import numpy as np
import PIL.Image
import pycolmap
import pytest
from captures import WALK, capture, flower_walk
from PIL.ExifTags import IFD, Base
from PIL.TiffImagePlugin import IFDRational
from processes import PATIENCE, wait_until
from synthetic import capture_in

from hydroviews.__main__ import poses_command
from hydroviews.captures.enhancer import find_enhancer
from hydroviews.captures.sfm import mapping, matching, pairs
from hydroviews.captures.sfm.mapping import is_plausible
from hydroviews.captures.sfm.poses import estimate_poses, triangulate
from hydroviews.captures.sfm.sources import link_photographs
from hydroviews.cli.processes import Ended
from hydroviews.errors import InputError
from hydroviews.files.ownership import FILES
from hydroviews.formats.capture_json import captured_rainy
from hydroviews.formats.geometry import misplaced, misplaced_note
from hydroviews.formats.read import read_scene
from hydroviews.scene.camera_errors import angles
from hydroviews.scene.images import write_png


@pytest.fixture(scope="module")
def flower(tmp_path_factory):
    """Nine photographs of a real capture at half size, in a folder and with names that need care."""
    folder = tmp_path_factory.mktemp("flower") / "my photos"
    for name, image in flower_walk():
        write_png(folder / "first walk" / f"a {name}.png", image)
    return folder


def worst_rotation(scene):
    """Degrees between the turns from the first view to the others and those of the solved capture, at most."""
    solved = [read_scene(capture("llff_flower")).views[index] for index in WALK]
    turns = [[view.camera.rotation @ views[0].camera.rotation.T for view in views] for views in (scene.views, solved)]
    return angles(np.swapaxes(turns[0], 1, 2) @ np.array(turns[1])).max()


def registered(folder, model, names):
    """Cameras of the registered photographs by name, and how many cameras there are."""
    matching.register(folder / "d.db", folder, names, model, shared=True)
    with pycolmap.Database.open(folder / "d.db") as opened:
        cameras = {name: opened.read_camera(opened.read_image_with_name(name).camera_id) for name in names}
        return cameras, opened.num_cameras()


def test_each_lens_begins_with_its_own_focal_length_or_a_telephones(tmp_path):
    """From pycolmap's longer one, views from one side end inside out."""
    for name, length in (("wide.jpg", 26), ("ultra.jpg", 13)):
        PIL.Image.new("RGB", (480, 320)).save(tmp_path / name, exif=exif_of(FocalLengthIn35mmFilm=length))
    PIL.Image.new("RGB", (8, 6)).save(tmp_path / "none.png")
    cameras, _ = registered(tmp_path, "SIMPLE_PINHOLE", ["wide.jpg", "ultra.jpg", "none.png"])
    wide, ultra, none = (camera.focal_length for camera in cameras.values())
    assert wide == pytest.approx(26 / 43.27 * np.hypot(480, 320), rel=0.05)
    assert wide / ultra == pytest.approx(2, rel=0.01)
    assert none == pytest.approx(0.9 * 8)


def exif_of(model="Phone 15", **tags):
    exif = PIL.Image.Exif()
    exif[Base.Make], exif[Base.Model] = "Maker", model
    for name, value in tags.items():
        exif.get_ifd(IFD.Exif)[getattr(Base, name)] = value
    return exif


@pytest.mark.parametrize(
    ("one", "other", "cameras"),
    [
        (exif_of(FocalLengthIn35mmFilm=26), exif_of(FocalLengthIn35mmFilm=13), 2),
        (exif_of(FocalLength=5.7), exif_of(FocalLength=2.2), 2),
        (exif_of(LensModel="wide"), exif_of(LensModel="ultra wide"), 2),
        (exif_of(), exif_of("Phone 16"), 2),
        (exif_of(DigitalZoomRatio=1.0), exif_of(DigitalZoomRatio=2.0), 2),
        (exif_of(FocalLength=5.7), exif_of(FocalLength=IFDRational(57, 10)), 1),
        (None, None, 1),
    ],
    ids=["35 mm", "focal length", "lens", "model", "digital zoom", "same", "no Exif"],
)
def test_photographs_of_one_size_have_a_camera_for_each_lens(tmp_path, one, other, cameras):
    names = [f"{i}.jpg" for i in range(6)]
    for i, name in enumerate(names):
        exif = (one, other)[i % 2]
        PIL.Image.new("RGB", (48, 32)).save(tmp_path / name, **({"exif": exif} if exif else {}))
    found, count = registered(tmp_path, "SIMPLE_RADIAL", names)
    ids = [found[name].camera_id for name in names]
    assert len(set(ids[::2])) == len(set(ids[1::2])) == 1
    assert len(set(ids)) == count == cameras


@pytest.fixture(scope="module")
def estimated(flower, tmp_path_factory):
    """Where a process that was interrupted after the features, and then a call, have estimated cameras; its errors."""
    script = "import sys; from pathlib import Path; from hydroviews.captures.sfm.poses import estimate_poses as run; "
    script += "run(Path(sys.argv[1]), Path(sys.argv[2]))"
    out = tmp_path_factory.mktemp("estimated") / "out"
    process = subprocess.Popen([sys.executable, "-c", script, flower, out], stderr=subprocess.PIPE, text=True)
    wait_until((out / "pairs.txt").exists, process)  # features are done
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=PATIENCE)
    assert process.returncode not in (0, -signal.SIGABRT)
    assert not (out / "sparse").exists()
    return out, errors, estimate_poses(flower, out)


def test_interrupted_estimation_goes_on_and_agrees_with_the_solved_poses(estimated, flower, tmp_path):
    out, errors, scene = estimated
    assert "KeyboardInterrupt" in errors
    assert scene.notes[0] == "cameras from sparse/0: 9 of 9 images registered"
    assert len(scene.points) > 300
    assert all(" " not in view.name for view in scene.views)
    assert worst_rotation(scene) < 1

    before = {path: path.stat().st_mtime_ns for path in (out / "sparse" / "0").iterdir()}
    link = next((out / "images").iterdir())
    link.unlink()
    link.symlink_to(tmp_path / "where it was")
    estimate_poses(flower, out)
    assert {path: path.stat().st_mtime_ns for path in before} == before
    assert link.resolve().parent == flower / "first walk"
    with pytest.raises(InputError, match=r"estimated otherwise\n.*seed"):
        estimate_poses(flower, out, seed=1)


@pytest.mark.parametrize("interruption", [KeyboardInterrupt, Ended])
def test_an_interruption_waits_for_the_safe_point(interruption):
    """By Ctrl-C, or by a signal that ends programs, during which another command would open the same database."""
    ended = []

    def tick():
        raise interruption(signal.SIGTERM)

    def call(cancellation_token):
        while not cancellation_token.is_cancelled:
            time.sleep(0.01)
        time.sleep(0.3)  # on the way to the safe point
        ended.append(True)

    with pytest.raises(interruption):
        matching.interruptible(call, tick)
    assert ended


def test_interrupted_mapping_goes_on_from_a_snapshot(estimated, flower, tmp_path, monkeypatch):
    shutil.copytree(estimated[0], tmp_path, symlinks=True, dirs_exist_ok=True)
    shutil.rmtree(tmp_path / "sparse")  # features and matches are there

    def interrupted(call):
        token, registered = pycolmap.CancellationToken(), []

        def register():
            registered.append(1)
            if len(registered) == 6:
                token.cancel()

        options = {"next_image_callback": register} if call.func is pycolmap.incremental_mapping else {}
        return call(cancellation_token=token, **options)

    monkeypatch.setattr(mapping, "SNAPSHOT_EVERY", 2)
    with monkeypatch.context() as patch, pytest.raises(InterruptedError):
        patch.setattr(matching, "interruptible", interrupted)
        estimate_poses(flower, tmp_path)
    assert len(list((tmp_path / mapping.MAPPING / "snapshots").iterdir())) >= 2
    scene = estimate_poses(flower, tmp_path)
    assert len(scene.views) == 9
    assert not (tmp_path / mapping.MAPPING).exists()
    assert worst_rotation(scene) < 1


def test_triangulated_points_fit_the_given_poses(tmp_path):
    scene = read_scene(capture("ngp_fox")).resized(320)
    views = [replace(view, name=name) for view, name in zip(scene.views, ["a b", "a_b"], strict=False)]
    scene = replace(scene, views=(*views, *scene.views[2:10]))  # the same name to COLMAP, which has no blanks in its
    points = triangulate(scene, tmp_path)
    assert len(points) > 200
    assert points.colours.std() > 10
    inside = np.zeros(len(points), int)
    for camera in (view.camera for view in scene.views):
        pixels, depth = camera.project(points.positions)
        inside += (depth > 0) & (pixels > 0).all(1) & (pixels < (camera.width, camera.height)).all(1)
    assert (inside >= 3).mean() > 0.95  # each is seen by three views
    again = triangulate(scene, tmp_path)  # from the finished database
    np.testing.assert_array_equal(again.positions, points.positions)


@pytest.fixture
def noise(tmp_path):
    """Three photographs that share nothing, and a call that cannot register them: the features that it found."""
    random = np.random.default_rng(0)
    for i in range(3):
        write_png(tmp_path / "noise" / f"{i}.png", random.random((64, 64, 3)).astype(np.float32))

    def find():
        with pytest.raises(InputError, match="could be registered"):
            estimate_poses(tmp_path / "noise", tmp_path / "out", rainy=True)
        with pycolmap.Database.open(tmp_path / "out" / mapping.DATABASE) as opened:
            images = {image.name: image.image_id for image in opened.read_all_images()}
            return {name: opened.read_keypoints(image) for name, image in images.items()}

    return find


@pytest.mark.usefixtures("noise")
def test_photographs_that_share_nothing(tmp_path):
    with pytest.raises(InputError, match=r"only 0 of 3 photographs could be registered\n.*\n.*take more"):
        estimate_poses(tmp_path / "noise", tmp_path / "out")
    assert not (tmp_path / "out" / "sparse").exists()


TOO_FEW = [("", "out", r"0 photographs\n.*no such folder"), ("a", "out", "1 photographs")]


@pytest.mark.parametrize(("names", "out", "message"), [*TOO_FEW, ("abc", "walk/out", "among the photographs")])
def test_too_few_photographs_or_results_among_them(tmp_path, names, out, message):
    for name in names:
        write_png(tmp_path / "walk" / f"{name}.png", np.zeros((8, 8, 3), np.float32))
    with pytest.raises(InputError, match=message):
        estimate_poses(tmp_path / "walk", tmp_path / out)


def test_a_copy_that_is_cut_short_is_made_again(tmp_path, monkeypatch):
    photograph, folder = tmp_path / "photographs" / "a.png", tmp_path / "images"
    write_png(photograph, np.zeros((8, 8, 3), np.float32))

    def cut_short(source, target):
        Path(target).write_bytes(source.read_bytes()[:20])
        raise KeyboardInterrupt

    monkeypatch.setattr(Path, "symlink_to", Mock(side_effect=OSError("no links here")))
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(shutil, "copy2", cut_short)
        link_photographs({"a.png": photograph}, folder, turned=False)
    assert {path.name for path in folder.iterdir()} <= {FILES}
    link_photographs({"a.png": photograph}, folder, turned=False)
    assert (folder / "a.png").read_bytes() == photograph.read_bytes()


def test_photographs_that_cannot_be_used_are_named_and_can_be_mended_or_left_out(noise, tmp_path):
    encoded = cv2.imencode(".jpg", np.random.default_rng(1).integers(0, 256, (240, 320, 3)).astype(np.uint8))[1]
    encoded[len(encoded) // 2 :][:6000] = 0
    damaged, empty = tmp_path / "noise" / "3.jpg", tmp_path / "noise" / "1.png"
    good = empty.read_bytes()
    for photograph, content, fault in ((damaged, encoded.tobytes(), "a damaged JPEG"), (empty, b"", "cannot be read")):
        photograph.write_bytes(content)
        with pytest.raises(InputError, match=f"{photograph}: {fault}"):
            estimate_poses(tmp_path / "noise", tmp_path / "out", rainy=True)
        damaged.unlink(missing_ok=True)
    empty.write_bytes(good)
    assert len(noise()) == 3


def test_work_on_other_photographs_is_begun_anew_until_cameras_are_found(noise, tmp_path, caplog):
    """Nothing but our own links is removed."""
    before, images, copy = noise(), tmp_path / "out" / "images", tmp_path / "out" / "database.db.bak"
    (images / "mine.jpg").write_bytes(b"the user's")
    copy.write_bytes(b"a copy")
    write_png(tmp_path / "noise" / "1.png", np.zeros((99, 99, 3), np.float32))
    write_png(tmp_path / "noise" / "more" / "3.png", np.zeros((64, 64, 3), np.float32))
    after = noise()
    assert set(after) == {"0.png", "1.png", "2.png", "3.png"}
    assert np.array_equal(before["0.png"], after["0.png"])
    assert len(after["1.png"]) == 0 < len(before["1.png"])
    assert "not written by HydroViews, and kept: images/mine.jpg" in caplog.text
    (tmp_path / "noise" / "2.png").unlink()
    noise()
    assert {path.name for path in images.iterdir()} == {"0.png", "1.png", "3.png", "mine.jpg"}
    assert copy.is_file()
    with pytest.raises(InputError, match=r"estimated otherwise[\s\S]*seed"):
        estimate_poses(tmp_path / "noise", tmp_path / "out", seed=1, rainy=True)


def test_cameras_of_other_photographs_are_kept(noise, tmp_path):
    noise()
    photograph = tmp_path / "noise" / "1.png"
    (tmp_path / "out" / "sparse").mkdir()
    renamed = photograph.rename(tmp_path / "noise" / "5.png")
    with pytest.raises(InputError, match=r"cameras of other photographs\n.*5\.png added; 1\.png gone"):
        estimate_poses(tmp_path / "noise", tmp_path / "out", rainy=True)
    write_png(renamed.rename(photograph), np.zeros((99, 99, 3), np.float32))
    with pytest.raises(InputError, match="of the same names and other sizes"):
        estimate_poses(tmp_path / "noise", tmp_path / "out", rainy=True)
    assert (tmp_path / "out" / mapping.DATABASE).is_file()


def test_photographs_and_a_database_in_the_folder_of_results_stay(noise, tmp_path):
    """`poses walk/noise --out walk`, with originals in walk/images and COLMAP's database: nothing is touched."""
    for name in ("images/ORIGINAL_0.jpg", "database.db", "sparse/0/cameras.bin"):
        folder = tmp_path / name.replace("/", "-")
        (folder / name).parent.mkdir(parents=True)
        (folder / name).write_bytes(b"the user's")
        (folder / "database.db.bak").write_bytes(b"a copy")
        for _ in range(2):
            with pytest.raises(InputError, match=rf"holds files that are not of this estimate[\s\S]*{re.escape(name)}"):
                estimate_poses(tmp_path / "noise", folder, rainy=True)
        found = {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}
        assert found == {name: b"the user's", "database.db.bak": b"a copy"}


def test_sequence_pairs_join_neighbours_and_close_loops():
    found = pairs.sequence_pairs(300)
    assert {(i, i + 1) for i in range(299)} <= found
    assert (0, 299) in found
    assert (10, 10 + 128) in found
    assert len(found) < 5000 < len(pairs.all_pairs(300))
    assert pairs.sequence_pairs(2) == {(0, 1)}
    assert all(i < j < 300 for i, j in found)


def test_pose_pairs_need_a_common_direction(tmp_path):
    scene = capture_in(tmp_path, n_views=36)  # a ring, ten degrees apart
    found = pairs.pose_pairs(np.stack([view.camera.world_to_camera for view in scene.views]))
    apart = {min(j - i, 36 - (j - i)) for i, j in found}
    assert {1, 2, 3, 4, 5} <= apart <= {1, 2, 3, 4, 5, 6}  # none beyond sixty degrees
    assert {(i, i + 1) for i in range(35)} <= found


@pytest.mark.parametrize(
    ("moved", "expected"),
    [
        ({}, []),
        ({17: (0, 50, 0)}, [17]),
        ({17: (0, 50, 0), 18: (0, 50, 1)}, [17, 18]),
        (dict.fromkeys(range(20, 40), (0, 50, 0)), []),  # a second walk elsewhere
        ({0: (-30, 0, 0)}, [0]),
    ],
    ids=["a line", "one", "two", "two walks", "the first"],
)
def test_misplaced_cameras(moved, expected):
    line = np.c_[np.arange(40.0), np.zeros(40), np.zeros(40)]
    for i, by in moved.items():
        line[i] += by
    assert misplaced(line) == expected
    said = ", ".join(f"v{i}" for i in expected) + ": more than 10 median"
    assert [note[: len(said)] for note in misplaced_note([f"v{i}" for i in range(40)], line)] == [said] * bool(expected)


@pytest.mark.parametrize(("focal", "plausible"), [(300.0, True), (80.0, True), (11.0, False), (1e6, False)])
def test_impossible_focal_lengths_are_recognised(focal, plausible):
    """Photographs from places one behind the other had a focal length of 11 pixels, and small models such of one."""
    camera = pycolmap.Camera.create_from_model_name(1, "SIMPLE_PINHOLE", focal, 320, 213)
    assert is_plausible(camera) == plausible


def test_a_capture_in_rain_says_so(tmp_path, monkeypatch):
    """Its photographs are not taken for clean views by the build that the command recommends; it is enhanced."""
    estimate = Mock(side_effect=lambda images, out, **_: capture_in(out))
    monkeypatch.setattr("hydroviews.__main__.estimate_poses", estimate)
    for rainy, enhance in ((False, None), (True, find_enhancer())):
        out = tmp_path / f"capture-{rainy}"
        poses_command(tmp_path / "walk", out, rainy=rainy)
        assert captured_rainy(out) == rainy
        assert estimate.call_args.kwargs["enhance"] == enhance


def test_enhancement_that_nobody_registered(monkeypatch):
    monkeypatch.setattr("hydroviews.captures.enhancer.registered", lambda group: {})
    with pytest.raises(InputError, match="no enhancement of rainy photographs is installed"):
        find_enhancer()
