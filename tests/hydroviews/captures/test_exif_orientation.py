"""Photographs as phones store them: pixels as the sensor lay, a tag for the turn, a focal length."""

import struct
import zlib

import cv2
import numpy as np
import PIL.Image
import pytest

from hydroviews.captures.exif_orientation import common_turn, orientation, write_upright
from hydroviews.errors import InputError
from hydroviews.scene.images import image_size, read_image, read_pixels, write_png

ORIENTATION, EXIF, FOCAL_35 = 0x0112, 0x8769, 0xA405
TURNS = {1: 0, 8: 1, 3: 2, 6: 3}  # quarter turns counter-clockwise to upright


def photograph(path, tag=None):
    """A JPEG with a texture that is brightest in its upper left corner as it is stored, and a focal length."""
    pixels = np.random.default_rng(0).integers(0, 120, (12, 16, 3), np.uint8)
    pixels = cv2.resize(pixels, (64, 48), interpolation=cv2.INTER_CUBIC)
    pixels[:16, :21] = 250
    exif = PIL.Image.Exif()
    if tag:
        exif[ORIENTATION] = tag
    exif.get_ifd(EXIF)[FOCAL_35] = 26
    PIL.Image.fromarray(pixels).save(path, quality=95, exif=exif)
    return path


def test_a_photograph_too_large_to_turn(tmp_path):
    large = photograph(tmp_path / "large.jpg", tag=6)
    content = large.read_bytes()
    frame = content.index(b"\xff\xc0")  # its header: length, bits, height, width
    large.write_bytes(content[: frame + 5] + b"\xff\xff\xff\xff" + content[frame + 9 :])
    assert orientation(large) == 1
    with pytest.raises(InputError, match="too large"):
        write_upright(large, tmp_path / "upright.jpg")


@pytest.mark.parametrize("tag", TURNS)
def test_a_photograph_is_turned_and_keeps_its_focal_length(tmp_path, tag):
    source, target = photograph(tmp_path / "a.jpg", tag=tag), tmp_path / "upright" / "a.jpg"
    assert orientation(source) == tag
    write_upright(source, target)
    assert orientation(target) == 1
    expected = np.rot90(read_image(source), TURNS[tag])
    assert image_size(target) == expected.shape[1::-1]
    assert np.abs(read_image(target) - expected).mean() < 0.02
    with PIL.Image.open(target) as image:
        assert image.getexif().get_ifd(EXIF)[FOCAL_35] == 26


def test_all_are_turned_or_none(tmp_path, caplog):
    upright, portrait = photograph(tmp_path / "a.jpg"), photograph(tmp_path / "b.jpg", tag=6)
    write_png(tmp_path / "c.png", np.zeros((4, 4, 3), np.float32))
    (tmp_path / "d.jpg").write_bytes(b"no picture")
    assert not common_turn([upright, tmp_path / "c.png", tmp_path / "d.jpg"])
    assert common_turn([portrait, portrait])
    assert orientation(photograph(tmp_path / "e.jpg", tag=77)) == 1
    assert caplog.text == ""
    assert not common_turn([upright, portrait])
    assert "upright and sideways" in caplog.text


def test_tiff_files_are_turned_or_refused(tmp_path):
    """Their pixels are read upright here, and as they are stored by COLMAP: the cameras would be of other pictures."""
    paths = [tmp_path / f"{name}.tif" for name in "abcd"]
    for path, tag in zip(paths, (6, 6, 1, 3), strict=True):
        PIL.Image.fromarray(np.zeros((6, 8, 3), np.uint8)).save(path, tiffinfo={ORIENTATION: tag})
    assert common_turn(paths[:2])
    assert not common_turn(paths[2:3])
    with pytest.raises(InputError, match=r"a\.tif, b\.tif, d\.tif with an Orientation tag"):
        common_turn(paths)


@pytest.mark.parametrize("tag", TURNS)
@pytest.mark.parametrize("suffix", ["png", "tif"])
def test_16_bits_stay_16_bits(tmp_path, suffix, tag):
    colours = np.random.default_rng(0).integers(0, 65536, (6, 8, 3), np.uint16)
    source, target = tmp_path / f"a.{suffix}", tmp_path / f"upright.{suffix}"
    content = cv2.imencode(f".{suffix}", colours)[1].tobytes()
    if suffix == "png":
        exif = PIL.Image.Exif()
        exif[ORIENTATION] = tag
        chunk = b"eXIf" + exif.tobytes().removeprefix(b"Exif\0\0")
        chunk = struct.pack(">I", len(chunk) - 4) + chunk + struct.pack(">I", zlib.crc32(chunk))
        source.write_bytes(content[:33] + chunk + content[33:])  # after the header
    else:
        planar = struct.pack("<HHII", 0x011C, 3, 1, 1)  # a tag that says what readers assume without it
        source.write_bytes(content.replace(planar, struct.pack("<HHII", ORIENTATION, 3, 1, tag)))
    assert orientation(source) == tag
    write_upright(source, target)
    assert orientation(target) == 1
    assert np.array_equal(read_pixels(target), np.rot90(colours, TURNS[tag]))
