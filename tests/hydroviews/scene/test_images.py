import struct
import zlib

import cv2
import numpy as np
import PIL.Image
import pytest

from hydroviews.errors import InputError
from hydroviews.scene.images import image_size, read_image, resize_area, to_linear, to_srgb, to_uint8, write_png
from hydroviews.scene.masks import read_grey


def test_png_round_trip_and_equal_bytes(tmp_path):
    image = np.random.default_rng(0).integers(0, 256, (5, 7, 3)).astype(np.float32) / 255
    for name in ("a.png", "b.png"):
        write_png(tmp_path / name, image)
    assert np.array_equal(read_image(tmp_path / "a.png"), image)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_sixteen_bit_grey_and_transparent_pictures(tmp_path):
    grey = np.arange(12, dtype=np.uint16).reshape(3, 4) * 5000
    cv2.imwrite(str(tmp_path / "grey.png"), grey)
    read = read_image(tmp_path / "grey.png")
    assert read.shape == (3, 4, 3)
    assert np.allclose(read, (grey / 65535)[..., None])
    rgba = np.array([[[200, 0, 0, 255]], [[200, 0, 0, 0]]], np.uint8)
    PIL.Image.fromarray(rgba).save(tmp_path / "rgba.png")
    assert np.allclose(read_image(tmp_path / "rgba.png")[:, 0], [[200 / 255, 0, 0], [0, 0, 0]])


@pytest.mark.parametrize("read", [image_size, read_image])
@pytest.mark.parametrize(
    ("name", "message"),
    [("empty.png", "cannot be read"), ("text.jpg", "cannot be read"), ("none.png", "no such image")],
)
def test_unreadable_pictures(tmp_path, read, name, message):
    (tmp_path / "empty.png").touch()
    (tmp_path / "text.jpg").write_bytes(b"not a picture")
    with pytest.raises(InputError, match=f"{name}: {message}"):
        read(tmp_path / name)


def test_transfer_curve_round_trip_and_known_value():
    x = np.linspace(0, 1, 256, dtype=np.float32)
    assert np.array_equal(to_uint8(to_srgb(to_linear(x))), to_uint8(x))
    assert to_linear(np.array([0.5]))[0] == pytest.approx(0.214041, abs=1e-5)


def test_area_average_keeps_the_mean_and_never_enlarges():
    image = np.random.default_rng(0).random((60, 80, 3), np.float32)
    assert resize_area(image, 40, 30) == pytest.approx(image.reshape(30, 2, 40, 2, 3).mean((1, 3)), abs=1e-6)
    with pytest.raises(ValueError, match="cannot enlarge"):
        resize_area(image, 81, 60)


@pytest.mark.parametrize("name", ["a.png", "a.jpg", "a.webp", "a.tif", "a.bmp"])
@pytest.mark.parametrize("orientation", [1, 6])
def test_sizes_are_those_of_the_pixels(tmp_path, name, orientation):
    exif = PIL.Image.Exif()
    exif[0x0112] = orientation
    PIL.Image.new("RGB", (50, 30)).save(tmp_path / name, **({} if name == "a.bmp" else {"exif": exif}))
    assert image_size(tmp_path / name) == read_image(tmp_path / name).shape[1::-1]


def test_sizes_are_read_without_the_pixels(tmp_path):
    PIL.Image.effect_noise((500, 300), 50).save(tmp_path / "whole.jpg")
    (tmp_path / "cut.jpg").write_bytes((tmp_path / "whole.jpg").read_bytes()[:1000])
    assert image_size(tmp_path / "cut.jpg") == (500, 300)


IDAT = struct.pack(">I", 1000) + b"IDAT" + bytes(1000)


def png_header(width: int, height: int) -> bytes:
    """A PNG that is cut short among its pixels."""
    header = b"IHDR" + struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + header + struct.pack(">I", zlib.crc32(header)) + IDAT


@pytest.mark.filterwarnings("ignore::PIL.Image.DecompressionBombWarning")
@pytest.mark.parametrize("size", [(60000, 45000), (20000, 15000), (40000, 10), (2**31 - 1, 2**31 - 1)])
@pytest.mark.parametrize("read", [image_size, read_image, read_grey])
def test_too_large_pictures_are_refused_by_their_headers(tmp_path, monkeypatch, size, read):
    monkeypatch.setattr(cv2, "imdecode", lambda *_: pytest.fail("decoded"))
    (tmp_path / "bomb.png").write_bytes(png_header(*size))
    with pytest.raises(InputError, match=r"bomb\.png: .*too large"):
        read(tmp_path / "bomb.png")
