import struct

import numpy as np
import PIL.Image
import pytest
from PIL import ImageCms

from hydroviews.scene.images import read_image, to_linear

# Primaries, adapted to D50, as columns X, Y, Z of red, green and blue.
P3 = np.array([[0.5151, 0.2412, -0.0011], [0.2920, 0.6922, 0.0419], [0.1571, 0.0666, 0.7841]])
PROPHOTO = np.array([[0.7977, 0.2880, 0.0], [0.1352, 0.7119, 0.0], [0.0313, 0.0001, 0.8249]])
SRGB = np.array([[0.4361, 0.2225, 0.0139], [0.3851, 0.7169, 0.0971], [0.1431, 0.0606, 0.7141]])
PICTURE = np.random.default_rng(0).uniform(0.15, 0.85, (6, 8, 3)).repeat(8, 0).repeat(8, 1)


def fixed(*values):
    return b"".join(struct.pack(">i", round(value * 65536)) for value in values)


def profile(primaries, gamma):
    """A display profile of version 2.4: three primaries and one gamma."""
    curve = b"curv" + bytes(4) + struct.pack(">IH", 1, round(gamma * 256)) + bytes(2)
    tags = {b"desc": b"desc" + bytes(4) + struct.pack(">I", 2) + b"a\0" + bytes(79)}
    tags |= {b"cprt": b"text" + bytes(4) + b"none\0", b"wtpt": b"XYZ " + bytes(4) + fixed(0.9642, 1, 0.8249)}
    for name, column in zip((b"r", b"g", b"b"), primaries, strict=True):
        tags |= {name + b"XYZ": b"XYZ " + bytes(4) + fixed(*column), name + b"TRC": curve}
    table, body = struct.pack(">I", len(tags)), b""
    start = 128 + 4 + 12 * len(tags)
    for name, content in tags.items():
        table += name + struct.pack(">II", start + len(body), len(content))
        body += content + bytes(-len(content) % 4)
    head = struct.pack(">I4sI", start + len(body), b"none", 0x02400000) + b"mntrRGB XYZ " + bytes(12) + b"acsp"
    return head.ljust(68, b"\0") + fixed(0.9642, 1, 0.8249).ljust(60, b"\0") + table + body


def in_profile(primaries, gamma):
    """PICTURE's colours as values of a profile, uint8."""
    light = to_linear(PICTURE) @ SRGB @ np.linalg.inv(primaries)
    return (255 * np.clip(light, 0, 1) ** (1 / gamma) + 0.5).astype(np.uint8)


def decibels(found):
    return -10 * np.log10(((found - PICTURE) ** 2).mean())


@pytest.mark.parametrize(
    ("primaries", "gamma", "ignored"), [(P3, 2.2, 33), (PROPHOTO, 1.8, 23)], ids=["P3", "ProPhoto"]
)
@pytest.mark.parametrize(
    ("suffix", "mode", "options"),
    [
        (".png", "RGB", {}),
        (".png", "RGBA", {}),
        (".jpg", "RGB", {"quality": 98, "subsampling": 0}),
        (".tif", "RGB", {}),
    ],
)
def test_colours_are_those_of_the_profile(tmp_path, caplog, primaries, gamma, ignored, suffix, mode, options):
    pixels, path = in_profile(primaries, gamma), tmp_path / f"a{suffix}"
    PIL.Image.fromarray(pixels).convert(mode).save(path, icc_profile=profile(primaries, gamma), **options)
    assert decibels(pixels / 255) < ignored
    assert decibels(read_image(path)) > 39
    assert caplog.text == ""


def test_a_profile_that_is_srgb_changes_no_bit(tmp_path):
    pixels = np.random.default_rng(1).integers(0, 256, (24, 32, 3)).astype(np.uint8)
    srgb = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    PIL.Image.fromarray(pixels).save(tmp_path / "a.png", icc_profile=srgb)
    assert np.array_equal(np.round(255 * read_image(tmp_path / "a.png")).astype(np.uint8), pixels)


@pytest.mark.parametrize("broken", [b"no profile", profile(P3, 2.2)[:200]])
def test_a_broken_profile_is_told_and_left_out(tmp_path, broken, caplog):
    pixels = np.full((4, 4, 3), 90, np.uint8)
    PIL.Image.fromarray(pixels).save(tmp_path / "a.png", icc_profile=broken)
    assert np.allclose(read_image(tmp_path / "a.png"), 90 / 255)
    assert "a colour profile that cannot be read" in caplog.text
