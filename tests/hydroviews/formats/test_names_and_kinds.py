"""Names that differ from those of the files, and files that are not what their names say."""

import shutil

import numpy as np
import PIL.Image
import pytest
from in_the_way import KINDS, not_for_ever, swap
from painted_room import scene_in_room, write_room, write_text_model
from refusals import assert_refused
from strangers import Stranger, write

from hydroviews.captures.video.decoding import open_video
from hydroviews.dataset.sources import find_capture
from hydroviews.errors import InputError
from hydroviews.formats.photographs import match_files, not_read, photographs_below
from hydroviews.formats.read import read_scene
from hydroviews.scene.images import list_images, read_image, write_png

BLACK = np.zeros((4, 4, 3), np.float32)


def files(folder, *names):
    for name in names:
        write_png(folder / name, BLACK)


@pytest.mark.parametrize(
    ("stored", "named"),
    [
        ("images/a.png", "images/A.PNG"),
        ("images/IMG_1.png", "images/img_1.png"),
        ("images/a.png", "a.png"),
        ("a.png", "cam0/a.png"),
        ("cam0/images/A.png", "images/a.png"),
        ("a.png", "C:/Users/me/walk/images/a.jpg"),
        ("images/B\u00e4ume.png", "images/Ba\u0308ume.png"),  # an umlaut in either way
        ("images/Ba\u0308ume.png", "images/B\u00e4ume.png"),
    ],
)
def test_a_name_of_other_capitals_or_folders_is_found_where_it_fits_alone(tmp_path, stored, named):
    files(tmp_path, stored, "other.png")
    assert match_files(tmp_path, [named]) == [tmp_path / stored]


def test_names_that_fit_several_files_are_not_guessed(tmp_path):
    files(tmp_path, "cam0/a.png", "cam1/a.png", "B.png")
    assert match_files(tmp_path, ["a.png"]) == [None]
    assert match_files(tmp_path, ["x/b.png", "y/b.png"]) == [None, None]
    assert match_files(tmp_path, ["cam0/a.png", "z/a.png"]) == [tmp_path / "cam0/a.png", tmp_path / "cam1/a.png"]


@pytest.mark.parametrize("form", ["colmap", "nerfstudio"])
def test_backslashes_are_folders(tmp_path, form):
    scene = scene_in_room(tmp_path / "walk")
    folder = write_room(scene, tmp_path / "walk", form)
    if form == "nerfstudio":
        path, changes = folder / "transforms.json", ("images/", "images" + 2 * "\\")
    else:
        shutil.rmtree(folder / "sparse")
        write_text_model(scene, folder / "sparse" / "0")
        path, changes = folder / "sparse/0/images.txt", (" view-", " cam0\\view-")
        (folder / "images").rename(folder / "pictures")
        shutil.move(folder / "pictures", folder / "images" / "cam0")
    path.write_text(path.read_text().replace(*changes))
    assert [view.name for view in read_scene(folder).views] == [view.name for view in scene.views]


@pytest.mark.parametrize("encoding", ["utf-16", "utf-8-sig"])
def test_text_models_of_windows(tmp_path, encoding):
    scene = scene_in_room(tmp_path / "walk")
    write_text_model(scene, tmp_path / "walk" / "sparse" / "0")
    for path in (tmp_path / "walk" / "sparse" / "0").iterdir():
        path.write_bytes(path.read_text().replace("\n", "\r\n").encode(encoding))
    assert len(read_scene(tmp_path / "walk").views) == 9


@pytest.mark.parametrize("blank", [True, False])
@pytest.mark.parametrize("emptied", [(), (4,), tuple(range(9))])
def test_poses_by_hand_are_all_read(tmp_path, blank, emptied):
    """With lines of keypoints, without, or with some of them taken out because they were empty."""
    scene = scene_in_room(tmp_path / "walk")
    write_text_model(scene, tmp_path / "walk" / "sparse" / "0", blank=blank)
    path = tmp_path / "walk" / "sparse" / "0" / "images.txt"
    lines = path.read_text().splitlines(keepends=True)
    if blank:
        path.write_text("".join(line for i, line in enumerate(lines) if not (i % 2 and i // 2 in emptied)))
    read = read_scene(tmp_path / "walk")
    assert [view.name for view in read.views] == [view.name for view in scene.views]
    for one, other in zip(read.views, scene.views, strict=True):
        assert np.allclose(one.camera.world_to_camera, other.camera.world_to_camera)
    assert "9 of 9 images registered" in read.notes[0]


def test_cameras_in_a_folder_below_are_named(tmp_path):
    write_room(scene_in_room(tmp_path / "walk" / "dense" / "0"), tmp_path / "walk" / "dense" / "0", "colmap")
    assert_refused(tmp_path / "walk", rf"cameras in dense/0\n[\s\S]*give that folder: {tmp_path}/walk/dense/0")


HEIC = b"\0\0\0\x18ftypheic" + bytes(200)


@pytest.mark.parametrize(
    ("content", "kind", "fix"),
    [
        (HEIC, "HEIC by its content", "convert it"),
        (b"\0\0\0\x18ftypavif" + bytes(200), "AVIF by its content", "convert it"),
        (b"%PDF-1.7" + bytes(99), "PDF by its content", "convert it"),
        (b"version https://git-lfs.github.com/spec/v1\n", "a pointer of Git LFS", "convert it"),
        (b"\xff\xd8\xff\xe0cut", "JPEG by its content", "may be cut short"),
        (bytes(99), "99 bytes", "may be cut short"),
    ],
)
def test_pictures_that_are_not_what_they_are_called_are_told(tmp_path, content, kind, fix):
    (tmp_path / "IMG_1.JPG").write_bytes(content)
    with pytest.raises(InputError, match=rf"IMG_1\.JPG: cannot be read as an image\n.*{kind}[\s\S]*{fix}"):
        read_image(tmp_path / "IMG_1.JPG")


def test_jpegs_called_heic_are_to_be_renamed(tmp_path):
    for i in range(4):
        PIL.Image.new("RGB", (4, 4)).save(tmp_path / f"IMG_{i}.HEIC", "JPEG")
    assert not_read(tmp_path) == "4 .heic, JPEG by content: rename them to .jpg"
    (tmp_path / "IMG_4.HEIC").write_bytes(HEIC)
    assert not_read(tmp_path) == "5 .heic, which are not read: convert them to .png or .jpg"


def test_an_archive_is_to_be_unpacked(tmp_path):
    files(tmp_path / "walk", "a.png")
    archive = shutil.make_archive(str(tmp_path / "walk"), "zip", tmp_path / "walk")
    for read in (read_scene, lambda path: find_capture(str(path), tmp_path, 4, 32)):
        with pytest.raises(InputError, match=r"a file, not a folder\n.*a zip archive[\s\S]*unpack it"):
            read(tmp_path / "walk.zip")
    with pytest.raises(InputError, match=r"an archive, not a film[\s\S]*unpack it"), open_video(tmp_path / archive):
        pass


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("form", "name"),
    [
        ("colmap binary", "split.json"),
        ("colmap binary", "capture.json"),
        ("colmap binary", "train_list.txt"),
        ("colmap binary", "room.tsv"),
        ("nerfstudio", "points.ply"),
    ],
)
def test_what_is_no_file_is_named(tmp_path, form, name, kind):
    folder = write(form, tmp_path, Stranger())
    if name == "train_list.txt":
        (folder / "test_list.txt").write_text("0.png\n")
    swap(folder / name, kind)
    with not_for_ever(), pytest.raises(InputError, match=rf"{name}: not a file\n  found: a {kind}"):
        read_scene(folder)


def test_folders_called_like_pictures_and_leftovers_of_network_storage_are_left_out(tmp_path):
    files(tmp_path, "a.png", "b.jpg/thumb.jpg", "@eaDir/a.png/SYNOPHOTO_THUMB_M.jpg", "#recycle/c.png", "._a.png")
    (tmp_path / "rejected.jpg").mkdir()
    assert photographs_below(tmp_path) == [tmp_path / "a.png", tmp_path / "b.jpg/thumb.jpg"]
    assert list_images(tmp_path) == [tmp_path / "a.png"]
