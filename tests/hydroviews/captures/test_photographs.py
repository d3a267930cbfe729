"""What the `poses` command says of a folder of photographs before it estimates cameras."""

import logging

import numpy as np
import PIL.Image
import pytest

from hydroviews.__main__ import poses_command
from hydroviews.captures.photographs import check_photographs
from hydroviews.errors import InputError
from hydroviews.formats.photographs import not_read


def pictures(folder, *names):
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        (folder / name).parent.mkdir(exist_ok=True)
        PIL.Image.fromarray(np.zeros((4, 4, 3), np.uint8)).save(folder / name)
    return folder


def test_formats_that_colmap_does_not_read_are_refused(tmp_path):
    walk = pictures(tmp_path / "walk", "a.png", "b.webp", "c.WEBP")
    with pytest.raises(InputError, match=r"COLMAP does not read\n.*b\.webp, c\.WEBP\n.*convert them"):
        poses_command(walk)
    assert not (tmp_path / "walk-capture").exists()


def test_photographs_that_are_left_out_are_counted(tmp_path, caplog):
    walk = pictures(tmp_path / "walk", "a.png", "b.png", "c.png")
    for name in ("d.HEIC", "e.heic", "f.jfif", "._d.HEIC"):
        (walk / name).write_bytes(b"")
    assert not_read(walk) == "2 .heic, 1 .jfif, which are not read: convert them to .png or .jpg"
    with caplog.at_level(logging.WARNING):
        check_photographs(walk, tmp_path / "out")
    assert not_read(walk) in caplog.text


@pytest.mark.parametrize("names", [("IMG 0.png", "IMG 1.png"), ("a/0.png", "b/0.png"), ("a/0.png", "1.png")])
def test_no_links_among_the_photographs(tmp_path, names):
    images = pictures(tmp_path / "walk" / "images", *names)
    with pytest.raises(InputError, match=r"links[\s\S]*choose another --out"):
        poses_command(images, tmp_path / "walk")
    check_photographs(images, tmp_path / "walk-capture")
    check_photographs(pictures(tmp_path / "plain" / "images", "0.png"), tmp_path / "plain")


@pytest.mark.parametrize(("photographs", "capture"), [("walk", "walk-capture"), ("walk/images", "walk-capture")])
def test_a_capture_is_called_after_the_folder_that_has_a_name(tmp_path, monkeypatch, photographs, capture):
    outs = []

    def estimate(images, out, rainy):
        outs.append(out)
        raise InputError("stop")

    monkeypatch.setattr("hydroviews.__main__.estimate_poses", estimate)
    with pytest.raises(InputError, match="stop"):
        poses_command(tmp_path / photographs)
    assert outs == [tmp_path / capture]
