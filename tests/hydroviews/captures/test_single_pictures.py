"""What a picture file says beside its pixels: Exif's turn, alpha, 16 bits."""

import cv2
import numpy as np
import PIL.Image
import PIL.ImageOps
import pytest

from deraings.enhancement import __main__ as commands
from hydroviews.captures.single_pictures import read_upright, turned
from hydroviews.errors import InputError
from hydroviews.scene.images import read_image

PIXELS = np.random.default_rng(0).integers(0, 256, (6, 8, 3)).astype(np.uint8).repeat(4, 0).repeat(4, 1)


def exif_of(tag):
    exif = PIL.Image.Exif()
    exif[0x0112] = tag
    return exif


@pytest.mark.parametrize("tag", range(1, 9))
def test_pictures_are_turned_as_viewers_do(tag):
    image = PIL.Image.fromarray(PIXELS)
    image.getexif()[0x0112] = tag
    assert np.array_equal(turned(PIXELS, tag), np.asarray(PIL.ImageOps.exif_transpose(image)))


JPEG = {"quality": 98, "subsampling": 0}


@pytest.mark.parametrize(
    ("suffix", "options", "error"),
    [("jpg", JPEG, 0.03), ("png", {}, 1e-6), ("tif", {}, 1e-6), ("webp", {"lossless": True}, 1e-6)],
)
def test_a_picture_on_its_side_is_read_upright(tmp_path, suffix, options, error):
    PIL.Image.fromarray(np.rot90(PIXELS)).save(tmp_path / f"a.{suffix}", exif=exif_of(6), **options)
    found = read_upright(tmp_path / f"a.{suffix}").image
    assert found.shape == PIXELS.shape
    assert np.abs(found - PIXELS / 255).mean() < error


@pytest.mark.parametrize(("kind", "scale"), [(np.uint8, 1), (np.uint16, 257)])
def test_alpha_and_the_colours_below_it_are_kept(tmp_path, kind, scale):
    alpha = np.zeros((24, 32), np.uint8)
    alpha[4:, 6:] = 200
    cv2.imwrite(str(tmp_path / "a.png"), np.dstack([PIXELS[..., ::-1], alpha]).astype(kind) * kind(scale))
    found = read_upright(tmp_path / "a.png")
    assert np.abs(found.image - PIXELS / 255).max() < 1e-6
    assert np.array_equal(found.alpha, alpha)
    assert found.bits == 8 * kind().itemsize


@pytest.fixture
def enhanced(tmp_path, monkeypatch):
    """Enhances the folder `in` by a network that leaves pictures as they are."""
    monkeypatch.setattr(commands, "load_enhancer", lambda _: type("Enhancer", (), {"reason": "", "network": None}))
    monkeypatch.setattr(commands, "enhance", lambda image, *_, **__: image)
    (tmp_path / "in").mkdir()
    return lambda out: commands.enhance_command(tmp_path / "in", out, apart=True)


def test_enhanced_pictures_stand_upright_and_keep_their_alpha(enhanced, tmp_path, capsys):
    PIL.Image.fromarray(np.rot90(PIXELS)).save(tmp_path / "in/a.jpg", exif=exif_of(6), **JPEG)
    alpha = np.zeros((24, 32), np.uint8)
    alpha[4:, 6:] = 255
    PIL.Image.fromarray(np.dstack([PIXELS, alpha])).save(tmp_path / "in/b.png")
    cv2.imwrite(str(tmp_path / "in/c.png"), PIXELS.astype(np.uint16) * 257)
    enhanced(tmp_path / "out")
    assert np.abs(read_image(tmp_path / "out/a.png") - PIXELS / 255).mean() < 0.03
    assert np.array_equal(np.asarray(PIL.Image.open(tmp_path / "out/b.png")), np.dstack([PIXELS, alpha]))
    assert "c.png: 16 bits a channel" in capsys.readouterr().out


def test_pictures_of_the_users_are_not_written_over_by_enhanced_ones(enhanced, tmp_path):
    PIL.Image.fromarray(PIXELS).save(tmp_path / "in/a.png")
    for _ in range(2):  # what it wrote itself, it writes anew
        enhanced(tmp_path / "out")
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/a.png").write_bytes(b"the user's")
    with pytest.raises(InputError, match=r"mine/a\.png: not written by HydroViews"):
        enhanced(tmp_path / "mine")
    assert (tmp_path / "mine/a.png").read_bytes() == b"the user's"
