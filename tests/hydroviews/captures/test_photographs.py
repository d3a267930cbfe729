"""What the `poses` command says of a folder of photographs before it estimates cameras."""

import os
import shutil
from types import SimpleNamespace

import numpy as np
import PIL.Image
import pytest

from hydroviews.__main__ import poses_command, video_command
from hydroviews.captures.photographs import camera_notes, check_photographs
from hydroviews.captures.sfm.room import room_for
from hydroviews.captures.video.decoding import open_video
from hydroviews.errors import InputError
from hydroviews.files.full_disk import FullDisk
from hydroviews.files.locks import locked_if_free
from hydroviews.formats.photographs import photographs_below


def pictures(folder, *names):
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        (folder / name).parent.mkdir(exist_ok=True)
        PIL.Image.fromarray(np.zeros((4, 4, 3), np.uint8)).save(folder / name)
    return folder


def test_what_colmap_does_not_read_is_named(tmp_path):
    walk = pictures(tmp_path / "walk", "a.png", "b.webp", "c.WEBP")
    with pytest.raises(InputError, match=r"COLMAP does not read\n.*b\.webp, c\.WEBP\n.*convert them"):
        poses_command(walk)
    linked = pictures(tmp_path / "linked", "a.png", "b.png", "c.png")
    (linked / "d.png").symlink_to(tmp_path / "lost.png")
    with pytest.raises(InputError, match=r"d\.png: a link to a photograph that is not there\n.*lost\.png"):
        poses_command(linked)
    assert not list(tmp_path.glob("*-capture"))


def test_photographs_that_are_left_out_are_counted(tmp_path, caplog):
    walk = pictures(tmp_path / "walk", "a.png", "b.png", "c.png")
    for name in ("d.HEIC", "e.heic", "f.jfif", "._d.HEIC"):
        (walk / name).write_bytes(b"")
    check_photographs(walk, tmp_path / "out")
    assert "2 .heic, 1 .jfif, which are not read: convert them to .png or .jpg" in caplog.text


@pytest.mark.parametrize("names", [("IMG 0.png", "IMG 1.png"), ("a/0.png", "b/0.png"), ("a/0.png", "1.png")])
def test_no_links_among_the_photographs(tmp_path, names):
    images = pictures(tmp_path / "walk" / "images", *names)
    with pytest.raises(InputError, match=r"links[\s\S]*choose another --out"):
        poses_command(images, tmp_path / "walk")
    check_photographs(images, tmp_path / "walk-capture")
    check_photographs(pictures(tmp_path / "plain" / "images", "0.png"), tmp_path / "plain")


@pytest.mark.parametrize(("command", "work"), [(poses_command, "estimate_poses"), (video_command, "capture_video")])
def test_two_commands_for_one_capture_wait_for_each_other(tmp_path, monkeypatch, command, work):
    def look(path, out, *_, **__):
        with locked_if_free(out) as free:
            raise InputError("free" if free else "locked")

    monkeypatch.setattr(f"hydroviews.__main__.{work}", look)
    with pytest.raises(InputError, match="locked"):
        command(tmp_path / "walk", tmp_path / "out")


def test_a_disk_without_room_is_refused_before_work_begins(tmp_path, monkeypatch):
    monkeypatch.setattr(shutil, "disk_usage", lambda folder: SimpleNamespace(free=2_500_000))
    out = tmp_path / "out"
    with pytest.raises(FullDisk, match=r"for 3 photographs\n.*0\.00 GB"), room_for(out, 3):
        raise AssertionError
    with room_for(out, 2):
        out.mkdir()
    (out / "database.db").write_bytes(bytes(500_000))  # features that are there take no more
    with room_for(out, 3):
        (out / "sparse").mkdir()
    with room_for(out, 99):
        pass


def test_what_may_not_be_read_is_not_called_damaged(tmp_path, monkeypatch):
    walk = pictures(tmp_path / "walk", "a.png", "b.png")
    (tmp_path / "film.mp4").write_bytes(b"film")
    for closed, read in (
        (walk, photographs_below),
        (walk / "b.png", lambda path: check_photographs(walk, tmp_path / "out")),
        (tmp_path / "film.mp4", lambda path: open_video(path).__enter__()),
    ):
        monkeypatch.setattr(os, "access", lambda path, mode, closed=closed: path != closed)
        with pytest.raises(InputError, match=f"{closed}: no permission"):
            read(closed)


def test_photographs_without_a_camera_are_named(tmp_path, monkeypatch, capsys):
    images = pictures(tmp_path / "out" / "images", "a.png", "black.png", "blurred.png")
    scene = SimpleNamespace(views=[SimpleNamespace(path=images / "a.png")], notes=("1 of 3 images registered",))
    monkeypatch.setattr("hydroviews.__main__.estimate_poses", lambda *given, **named: scene)
    poses_command(pictures(tmp_path / "walk", "a.png"), tmp_path / "out")
    assert "without a camera, and left out: black.png, blurred.png\n" in capsys.readouterr().out
    for name in ("black.png", "blurred.png"):
        (images / name).unlink()
    assert camera_notes(scene, images) == []
