"""JPEGs and TIFFs whose middle is damaged decode, with a warning that nobody sees: they are refused."""

import re

import cv2
import numpy as np
import PIL.Image
import pytest
import tifffile
from synthetic import written_capture

from hydroviews.dataset.build import build
from hydroviews.errors import InputError
from hydroviews.formats.read import read_scene
from hydroviews.scene.images import read_image
from hydroviews.scene.photograph_damage import require_whole
from hydroviews.scene.tiff_damage import tiff_fault

PLAIN, PROGRESSIVE = [], [cv2.IMWRITE_JPEG_PROGRESSIVE, 1]
RESTARTS = [cv2.IMWRITE_JPEG_RST_INTERVAL, 4]


PICTURE = cv2.resize(np.random.default_rng(0).integers(0, 256, (60, 80, 3)).astype(np.uint8), (320, 240))


def jpeg(settings):
    return cv2.imencode(".jpg", PICTURE, settings)[1].tobytes()


def with_bytes(content, start, other):
    return content[:start] + other + content[start + len(other) :]


def random_bytes(content, count=6000):
    other = np.random.default_rng(1).integers(0, 256, count).astype(np.uint8).tobytes()
    return with_bytes(content, len(content) // 2, other)


def few_random_bytes(content):
    return random_bytes(content, 60)


def sector_of_zeros(content):
    return with_bytes(content, 8192, bytes(4096))


def write(path, content):
    path.write_bytes(content)
    return path


def test_damage_in_the_middle_is_told_and_whole_pictures_are_not(tmp_path):
    whole, damaged = [tmp_path / "picture.png", tmp_path / "missing.jpg"], []
    whole[0].write_bytes(b"no JPEG")
    for name, settings in (("plain", PLAIN), ("progressive", PROGRESSIVE), ("restarts", RESTARTS)):
        content = jpeg(settings)
        assert len(content) > 14_000
        whole += [write(tmp_path / f"{name}.jpg", content)]
        whole += [write(tmp_path / f"{name}-padded.jpg", content[:-2] + b"\0\0" + content[-2:])]  # as some cameras do
        for damage in (random_bytes, sector_of_zeros):
            damaged += [write(tmp_path / f"{name}-{damage.__name__}.JPEG", damage(content))]
    assert read_image(damaged[1]).shape == (240, 320, 3)  # OpenCV sees a picture
    require_whole(whole, "")
    expected = r"plain-random_bytes\.JPEG: a damaged JPEG, and 5 more photographs\n  found: Corrupt JPEG data"
    with pytest.raises(InputError, match=expected):
        require_whole([*whole, *damaged], "")


def tiff(path, compression, dtype=np.uint8):
    """A TIFF of many strips."""
    picture = PICTURE.astype(dtype) * (257 if dtype == np.uint16 else 1)
    settings = [cv2.IMWRITE_TIFF_COMPRESSION, compression, cv2.IMWRITE_TIFF_ROWSPERSTRIP, 16]
    assert cv2.imwrite(str(path), picture, settings)
    return path


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("compression", [5, 8, 32946], ids=["lzw", "deflate", "adobe"])
@pytest.mark.parametrize("damage", [random_bytes, sector_of_zeros, few_random_bytes])
def test_a_damaged_tiff_has_a_fault_and_a_whole_one_none(tmp_path, compression, damage, dtype):
    path = tiff(tmp_path / "a.tif", compression, dtype)
    assert not tiff_fault(path)
    assert re.match("strip [0-9]+ of 15: ", tiff_fault(write(path, damage(path.read_bytes()))))


def test_a_damaged_tiff_is_told(tmp_path):
    whole = [tiff(tmp_path / f"{compression}.tif", compression) for compression in (1, 5)]
    damaged = write(tmp_path / "damaged.tif", few_random_bytes(whole[1].read_bytes()))
    with pytest.raises(InputError, match=r"/damaged\.tif: a damaged TIFF\n  found: strip [0-9]+ of 15: "):
        require_whole([*whole, damaged], "")


def test_tiffs_of_other_makes_are_whole(tmp_path):
    pixels = np.random.default_rng(0).integers(0, 256, (50, 61, 3)).astype(np.uint8)
    for mode in ("RGB", "RGBA", "L", "1", "P", "CMYK"):
        for compression in ("tiff_lzw", "tiff_adobe_deflate", "packbits", None):
            picture = PIL.Image.fromarray(pixels).convert(mode)
            picture.save(tmp_path / f"{mode}-{compression}.tif", compression=compression)
    settings = {"compression": "zlib", "photometric": "rgb"}
    for tile in (None, (16, 16)):
        tifffile.imwrite(tmp_path / f"a-{tile}.tif", pixels, tile=tile, planarconfig="contig", **settings)
        planes = np.moveaxis(pixels, 2, 0)
        tifffile.imwrite(tmp_path / f"b-{tile}.tif", planes, tile=tile, planarconfig="separate", **settings)
    paths = sorted(tmp_path.glob("*.tif"))
    assert len(paths) == 6 * 4 + 2 * 2
    require_whole(paths, "")


def test_padding_of_any_length_is_no_damage(tmp_path):
    """As of cameras that fill their files up: before the end mark, or before every restart mark."""
    plain, restarts, paths = jpeg(PLAIN), jpeg(RESTARTS), []
    whole = [write(tmp_path / "plain.jpg", plain), write(tmp_path / "restarts.jpg", restarts)]
    head, data = restarts[: restarts.index(b"\xff\xda")], restarts[restarts.index(b"\xff\xda") :]
    for filler in (b"\0", b"\xff"):
        for count in (1, 12, 5000):
            ended = plain[:-2] + filler * count + plain[-2:] + b"a preview behind the picture"
            restarted = head + re.sub(rb"(\xff[\xd0-\xd7])", filler * min(count, 14) + rb"\1", data)
            for name, content, before in (("end", ended, whole[0]), ("restarts", restarted, whole[1])):
                paths.append(write(tmp_path / f"{name}-{filler.hex()}-{count}.jpg", content))
                assert np.array_equal(read_image(paths[-1]), read_image(before))
    require_whole(paths, "")


RUBBISH = np.random.default_rng(0).integers(1, 200, 40).astype(np.uint8).tobytes()


@pytest.mark.parametrize(
    ("settings", "lost", "instead"),
    [*((settings, lost, bytes(lost)) for settings in (PLAIN, RESTARTS) for lost in (300, 4096)), (PLAIN, 0, RUBBISH)],
    ids=["zeros", "many zeros", "zeros among restarts", "many zeros among restarts", "rubbish"],
)
def test_other_bytes_before_the_end_mark_are_damage(tmp_path, settings, lost, instead):
    """Zeros as where a copy was broken off and the file had its length before."""
    content = jpeg(settings)
    with pytest.raises(InputError, match="a damaged JPEG"):
        require_whole([write(tmp_path / "a.jpg", content[: -2 - lost] + instead + content[-2:])], "")


def test_a_ground_truth_is_not_made_of_a_damaged_photograph(tmp_path):
    capture = written_capture(tmp_path / "capture" / "yard", width=320, height=240)
    for path in list((capture / "images").glob("view-*.png")):
        path.unlink()
        write(path.with_suffix(".jpg"), jpeg(PLAIN))
    bad = write(capture / "images" / "view-05.jpg", sector_of_zeros(jpeg(PLAIN)))
    with pytest.raises(InputError, match=r"view-05\.jpg: a damaged JPEG\n"):
        build(read_scene(capture), tmp_path / "data", patterns=[])
    assert not list((tmp_path / "data").rglob("*.png"))
    write(bad, jpeg(PLAIN))
    assert build(read_scene(capture), tmp_path / "other", patterns=[]) == tmp_path / "other" / "yard"
