from pathlib import Path

import numpy as np
import pytest
from distorted import colmap_capture
from paired import wet
from synthetic import written_capture

from hydroviews.dataset.checks.verify import verify
from hydroviews.dataset.manifest import data_hash, record_files
from hydroviews.dataset.sources import build_source
from hydroviews.errors import InputError
from hydroviews.formats.capture_json import CAPTURED
from hydroviews.formats.read import read_scene
from hydroviews.profiles import find_profile
from hydroviews.scene.images import write_png
from hydroviews.scene.masks import read_grey

DEMO = find_profile("demo")


@pytest.fixture
def church(tmp_path):
    """A waterdrop capture of 9 views of 48x36 without masks."""
    return written_capture(tmp_path / "root" / "waterdrops" / "church")


@pytest.fixture
def masks():
    """[18, 24, 9]: in the i-th photograph column i is a drop; the last has none."""
    array = np.zeros((18, 24, 9))
    array[:, range(8), range(8)] = 1
    return array


def read_drops(folder: Path, view: str) -> np.ndarray | None:
    path = folder / CAPTURED / "drops" / f"{view}.png"
    return read_grey(path) > 127 if path.is_file() else None


def built(tmp_path: Path, **changes) -> Path:
    return build_source("church", tmp_path / "data", DEMO, captures=tmp_path / "root", **changes)


@pytest.mark.parametrize("kind", [np.float32, np.float64, np.bool_, "0 to 255"])
def test_the_array_of_masks_is_kept_at_the_built_size(church, masks, tmp_path, kind):
    np.save(church / "rainMask.npy", (masks * 255).astype(np.uint8) if kind == "0 to 255" else masks.astype(kind))
    folder = built(tmp_path)
    drops = [read_drops(folder, f"view-{i:02d}") for i in range(9)]
    assert [plane.shape for plane in drops] == [(36, 48)] * 9
    for i, plane in enumerate(drops[1:8], 1):  # a pixel that a drop touches is one
        assert sorted(set(np.nonzero(plane)[1])) == [2 * i - 1, 2 * i, 2 * i + 1, 2 * i + 2]
    assert not drops[8].any()
    assert verify(tmp_path / "data") == []
    stamp = (tmp_path / "data" / "manifest.json").stat().st_mtime_ns
    built(tmp_path)
    assert (tmp_path / "data" / "manifest.json").stat().st_mtime_ns == stamp


def test_pictures_of_masks(church, tmp_path):
    picture = np.zeros((36, 48, 3), np.uint8)
    picture[:10] = 255
    write_png(church / "rain_masks" / "view-03.png.png", picture)
    folder = built(tmp_path, long_side=24)
    assert np.array_equal(read_drops(folder, "view-03")[:, 0], np.arange(18) < 5)
    assert read_drops(folder, "view-04") is None
    assert verify(tmp_path / "data") == []
    before = data_hash(folder.parent, folder.name, CAPTURED)
    drops = f"{CAPTURED}/drops/view-03.png"
    write_png(folder / drops, np.zeros((18, 24, 3), np.uint8))
    record_files(folder.parent, folder.name, [drops])
    assert data_hash(folder.parent, folder.name, CAPTURED) != before  # methods may learn from them


def test_masks_beside_rainy_and_clean_photographs(church, masks, tmp_path):
    (church / "images").rename(church / "clean")
    for path in (church / "clean").glob("[!.]*"):
        wet(church / "rainy" / path.name, path)
    np.save(church / "rainMask.npy", masks)
    folder = built(tmp_path)
    assert len(list((folder / CAPTURED / "drops").glob("[!.]*"))) == len(list((folder / "clean").glob("[!.]*"))) == 9
    assert read_drops(folder, "view-01")[:, 2:4].all()
    assert verify(tmp_path / "data") == []


@pytest.mark.parametrize(
    ("array", "message"),
    [
        (np.zeros((18, 24, 8)), "masks for other photographs\n.*8 masks, 9 photographs"),
        (np.zeros((18, 20, 9)), "differ in size"),
        (np.zeros((18, 24)), "not an array of masks"),
        (np.array(["a"]), "not an array of masks"),
        (b"\x93NUMPY cut", "not a NumPy array"),
    ],
    ids=["eight", "narrow", "one", "text", "damaged"],
)
def test_masks_of_something_else_are_refused(church, tmp_path, array, message):
    path = church / "rainMask.npy"
    path.write_bytes(array) if isinstance(array, bytes) else np.save(path, array)
    with pytest.raises(InputError, match=message):
        built(tmp_path)


def test_masks_of_distorted_photographs_are_undistorted_like_them(tmp_path):
    folder = colmap_capture(tmp_path / "root" / "waterdrops" / "church")
    picture = np.zeros((72, 96, 3), np.uint8)
    picture[:24, :24] = 255
    write_png(folder / "rain_masks" / "view00.png.png", picture)
    write_png(folder / "masks" / "view00.png.png", 255 - picture)
    ignored = read_scene(folder).resized(DEMO.long_side).views[0].ignored()
    drops = read_drops(built(tmp_path), "view00")
    assert np.array_equal(drops, ignored)
    assert not np.array_equal(drops, picture[..., 0] > 0)
