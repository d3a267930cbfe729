"""Readers given damaged files: they read or raise InputError, in bounded memory, and touch nothing outside the capture.

Each test tries EXAMPLES damaged files, the same ones every time; FUZZ_EXAMPLES tries so many others (`make fuzz`).
"""

import json
import os
from pathlib import Path

import numpy as np
import PIL.Image
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mutations import guarded, mutated, with_odd_value
from strangers import FORMATS, Stranger, write

from hydroviews.errors import InputError
from hydroviews.formats.read import read_scene
from hydroviews.scene.checks import FARTHEST
from hydroviews.scene.exif import orientation
from hydroviews.scene.images import image_size, read_image
from hydroviews.scene.masks import read_ignored
from hydroviews.scene.scenes import Scene

EXAMPLES = int(os.environ.get("FUZZ_EXAMPLES", 25))
fuzzed = settings(
    max_examples=EXAMPLES,
    derandomize="FUZZ_EXAMPLES" not in os.environ,
    database=None,
    deadline=None,
    suppress_health_check=list(HealthCheck),
)
pytestmark = pytest.mark.filterwarnings(
    "error", "ignore::PIL.Image.DecompressionBombWarning", "ignore::UserWarning:PIL"
)

LENS = Stranger(model="OPENCV", distortion=(-0.1, 0.02, 0.001, -0.001))
COLMAP = [f"sparse/0/{file}" for file in ("cameras", "images", "points3D")]
FILES = [
    *(("colmap text", f"{file}.txt") for file in COLMAP),
    *(("colmap binary", f"{file}.bin") for file in COLMAP),
    ("nerfstudio", "transforms.json"),
    ("nerfstudio", "points.ply"),
    ("llff", "poses_bounds.npy"),
    ("nsvf", "pose/2.txt"),
    ("nsvf", "intrinsics.txt"),
    ("colmap binary", "split.json"),
    ("colmap binary", "capture.json"),
]
JSON = [file for file in FILES if file[1].endswith(".json")]


@pytest.fixture(scope="module")
def captures(tmp_path_factory) -> dict[str, Path]:
    """A capture in every format, each with a split and a description, and a picture outside."""
    folders = {}
    for kind in FORMATS:
        lens = LENS if kind in ("colmap text", "colmap binary", "nerfstudio") else Stranger()
        folder = write(kind, tmp_path_factory.mktemp("fuzzed") / "capture", lens)
        (folder / "split.json").write_text('{"train": ["1", "2", "3"], "test": ["0"], "sparse": ["1", "3"]}')
        (folder / "capture.json").write_text('{"rain": "none", "metres_per_unit": 1.5, "drops_cost": 2}')
        PIL.Image.new("RGB", (96, 72)).save(folder.parent / "secret.png")
        folders[kind] = folder
    return folders


def read_damaged(folder: Path, file: str, content: bytes) -> None:
    """Read the capture with that content in one of its files, then put back what was there."""
    path = folder / file
    whole = path.read_bytes()
    path.write_bytes(content)
    try:
        with guarded(folder):
            scene = read_scene(folder)
            scene.views[0].rounded()
    except InputError:
        return
    finally:
        path.write_bytes(whole)
    check_possible(scene)


def check_possible(scene: Scene) -> None:
    """What any scene that was read promises."""
    assert len(scene.views) >= 3
    for view in scene.views:
        camera = view.camera
        assert np.isfinite(camera.matrix).all()
        assert min(camera.fx, camera.fy) > 0
        assert np.abs(camera.centre).max() <= 2 * FARTHEST
        assert 0 < camera.width * camera.height < 10**6
        view.name.encode()
    assert np.abs(scene.points.positions).max(initial=0) <= FARTHEST
    assert scene.points.colours.dtype == np.uint8
    assert len(scene.points.colours) == len(scene.points)


@pytest.mark.parametrize(("kind", "file"), FILES)
@fuzzed
@given(data=st.data())
def test_damaged_files_of_a_capture(captures, kind, file, data):
    folder = captures[kind]
    read_damaged(folder, file, data.draw(mutated((folder / file).read_bytes())))


@pytest.mark.parametrize(("kind", "file"), JSON)
@fuzzed
@given(data=st.data())
def test_odd_values_in_json(captures, kind, file, data):
    folder = captures[kind]
    value = data.draw(with_odd_value(json.loads((folder / file).read_text())))
    read_damaged(folder, file, json.dumps(value).encode())


@pytest.fixture(scope="module")
def pictures(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("fuzzed") / "pictures"
    folder.mkdir()
    picture = PIL.Image.effect_mandelbrot((40, 30), (-2, -1, 1, 1), 20)
    exif = PIL.Image.Exif()
    exif[0x0112] = 6
    for suffix in ("png", "jpg", "tif", "bmp", "webp"):
        picture.save(folder / f"whole.{suffix}", **({} if suffix == "bmp" else {"exif": exif}))
    return folder


@pytest.mark.parametrize("suffix", ["png", "jpg", "tif", "bmp", "webp"])
@fuzzed
@given(data=st.data())
def test_damaged_pictures(pictures, suffix, data):
    content = (pictures / f"whole.{suffix}").read_bytes()
    header = data.draw(st.booleans())  # most of a picture's numbers stand at its beginning
    damaged = data.draw(mutated(content[:200])) + content[200:] if header else data.draw(mutated(content))
    path = pictures / f"damaged.{suffix}"
    path.write_bytes(damaged)
    for read in (image_size, read_image, read_ignored, orientation):
        with guarded(pictures):
            try:
                read(path)
            except InputError:
                continue
