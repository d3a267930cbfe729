"""Captures in the package: what is unpacked is what was rendered, and rendering again gives about the same."""

from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
from damage import damage, files
from kept_blender import needs_blender

from hydroviews.__main__ import download_command
from hydroviews.blender.embedded_scenes import captures
from hydroviews.blender.embedded_scenes.captures import VERSION, read_embedded
from hydroviews.captures.packed.archives import FOLDER, HASHES, UNPACKED, pack, read_checked, unpack
from hydroviews.captures.packed.depth_code import decode, encode
from hydroviews.captures.packed.sample import CLIP, copy_sample
from hydroviews.captures.video.decoding import open_video, video_frames
from hydroviews.dataset.sources import find_capture
from hydroviews.errors import InputError
from hydroviews.files.atomic import read_json, write_json
from hydroviews.profiles import find_profile
from hydroviews.scene.depth import stored_depth, write_depth
from hydroviews.scene.images import read_image, resize_area, write_png

SHIPPED = "courtyard-40-320x240"
MEGABYTES = 9
SMALLER = 4  # times, on each side: what is rendered to compare


def planes_and_sky(rng) -> np.ndarray:
    """Depth of two slanted planes with an edge between them, under a sky: [3, 24, 32]."""
    y, x = np.mgrid[:24, :32]
    slopes = rng.uniform(-0.002, 0.002, (3, 2, 1, 1))
    near, far = 1 / (0.4 + slopes[:, 0] * x + 0.001 * y), 1 / (0.1 + slopes[:, 1] * y)
    depth = np.where(x < 16, near, far)
    depth[:, :4] = np.inf
    return depth.astype(np.float32)


def rendered(folder: Path, rng) -> Path:
    """A capture as rendering leaves it, with made-up pixels."""
    views = [{"name": f"{i:03d}", "width": 32, "height": 24} for i in range(3)]
    for view, depth in zip(views, planes_and_sky(rng), strict=True):
        write_png(folder / "images" / f"{view['name']}.png", rng.integers(0, 256, (24, 32, 3), np.uint8))
        write_depth(folder / "depth" / f"{view['name']}.exr", depth)
    np.savez_compressed(folder / "points.npz", positions=rng.normal(size=(9, 3)))
    request = {"version": VERSION, "scene": "courtyard", "seed": 0}
    write_json(folder / "request.json", request)
    write_json(folder / "cameras.json", {"request": request, "views": views})
    return folder


def contents(folder: Path) -> dict[str, bytes]:
    return {name: content for name, content in files(folder).items() if name != UNPACKED}


@pytest.fixture
def archives(tmp_path):
    """The folder of the archive of a rendered capture."""
    (tmp_path / "archives").mkdir()
    pack(rendered(tmp_path / "rendered" / "yard", np.random.default_rng(0)), tmp_path / "archives")
    return tmp_path / "archives"


@pytest.fixture
def whole(archives):
    """The contents of the archive."""
    return contents(archives.parent / "rendered" / "yard")


def test_depth_comes_back_bit_by_bit():
    rng = np.random.default_rng(0)
    any_bits = rng.integers(0, 2**32, (2, 7, 5), np.uint32).view(np.float32)  # negative, denormal, not a number
    for depth in (planes_and_sky(rng), any_bits, any_bits[:, :1], np.full((1, 3, 2), np.inf, np.float32)):
        assert decode(encode(depth), depth.shape).tobytes() == depth.tobytes()


def test_a_capture_is_unpacked_as_it_was_rendered_and_what_is_there_is_kept(archives, whole, tmp_path):
    folder = tmp_path / "data" / "yard"
    assert unpack(folder, VERSION, archives)
    assert contents(folder) == whole
    assert read_json(folder / UNPACKED)["licence"] == "Apache-2.0"
    for name in ("cameras.json", "images/001.png", "depth/002.exr"):
        (folder / name).unlink()
    kept = (folder / "images/000.png").stat().st_mtime_ns
    assert unpack(folder, VERSION, archives)
    assert contents(folder) == whole
    assert (folder / "images/000.png").stat().st_mtime_ns == kept


def test_what_another_renderer_left_is_replaced_and_files_of_others_stay(archives, whole, tmp_path):
    folder = rendered(tmp_path / "data" / "yard", np.random.default_rng(1))
    write_json(folder / "request.json", {"version": VERSION - 1})
    (folder / "images" / "mine.png").write_bytes(b"a picture")
    assert unpack(folder, VERSION, archives)
    assert contents(folder) == {**whole, "images/mine.png": b"a picture"}


def test_a_damaged_archive_is_refused(archives, tmp_path):
    damage(archives / "yard.zip")
    with pytest.raises(InputError, match=r"yard\.zip: damaged[\s\S]*SHA256SUMS[\s\S]*install HydroViews again"):
        unpack(tmp_path / "data" / "yard", VERSION, archives)
    assert not (tmp_path / "data").exists()


@pytest.fixture
def find(monkeypatch, tmp_path):
    """Finds the courtyard as the demo does, or at another size; to ask Blender for anything is an error."""
    monkeypatch.setattr(captures, "run_blender", Mock(side_effect=RuntimeError("asked")))
    demo = find_profile("demo")
    return lambda size=demo.long_side, **how: find_capture("courtyard", tmp_path, demo.embedded_views, size, **how)


def test_the_first_scene_needs_no_rendering(find, tmp_path):
    for _ in range(2):  # unpacked, and kept
        scene = find()
    assert (len(scene.views), len(scene.points.positions)) == (40, 16000)
    assert {read_image(view.path).shape for view in scene.views[::20]} == {(240, 320, 3)}
    assert max(path.name for path in (tmp_path / SHIPPED / "depth").glob("*.exr")) == "039.exr"
    with pytest.raises(RuntimeError, match="asked"):  # another size is not in the package
        find(64)


def test_it_is_rendered_if_asked_for(find, tmp_path):
    for _ in range(2):
        with pytest.raises(RuntimeError, match="asked"):
            find(render=True)
        assert not list((tmp_path / SHIPPED / "images").glob("*.png"))
        find()
    with pytest.raises(InputError, match="SCENE=fox: not rendered here"):
        find_capture("fox", tmp_path, 40, 320, render=True)


def test_the_files_of_the_package_are_small_and_hashed():
    files = [f"{SHIPPED}.zip", CLIP]
    assert sorted(path.name for kind in ("zip", "mp4") for path in FOLDER.glob(f"*.{kind}")) == files
    assert [line.split()[1] for line in (FOLDER / HASHES).read_text().splitlines()] == files
    assert all(read_checked(FOLDER / name) for name in files)
    assert sum((FOLDER / name).stat().st_size for name in files) < MEGABYTES * 1e6


@needs_blender
def test_rendering_again_gives_about_what_is_packed(kept_blender, tmp_path):
    """One view at a quarter of the size: within a few grey levels of the packed one, far closer than its neighbour."""
    shipped, fresh = tmp_path / SHIPPED, tmp_path / "fresh"
    unpack(shipped, VERSION)
    view = read_json(shipped / "cameras.json")["views"][17]
    small = {**view, **{name: view[name] // SMALLER for name in ("width", "height")}}
    small |= {name: view[name] / SMALLER for name in ("fx", "fy", "cx", "cy")}
    request = {"scene": "courtyard", "folder": str(fresh), "seed": 0, "views": [small]}
    kept_blender("render_views", request, tmp_path / "log", "test")
    ours, views = read_image(fresh / "images/017.png"), read_embedded("courtyard", shipped).views
    errors = {i: np.abs(ours - resize_area(views[i].image(), 80, 60)).mean() for i in (17, 18)}
    assert errors[17] < 0.04 < 0.1 < errors[18]
    depth = stored_depth(fresh / "depth/017.exr")
    packed = stored_depth(shipped / "depth/017.exr")[2::SMALLER, 2::SMALLER]
    both = np.isfinite(depth) & np.isfinite(packed)
    assert both.mean() > 0.7
    assert np.median(np.abs(depth[both] / packed[both] - 1)) < 0.01


def test_the_sample_clip_is_a_small_video_that_is_copied_once(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    download_command("sample")
    assert "hydroviews reconstruct sample.mp4" in capsys.readouterr().out
    copy = tmp_path / CLIP
    assert copy.stat().st_size < 3e6
    with open_video(copy) as video:
        shapes = [frame.pixels.shape for frame in video_frames(video)]
    assert len(shapes) >= 20
    assert set(shapes) == {(240, 320, 3)}
    written = copy.stat().st_mtime_ns
    assert copy_sample(tmp_path) == copy
    assert copy.stat().st_mtime_ns == written
    copy.write_bytes(b"a video of mine")
    with pytest.raises(InputError, match=r"sample\.mp4: another file[\s\S]*--out"):
        copy_sample(tmp_path)
    assert copy.read_bytes() == b"a video of mine"


@pytest.mark.parametrize(("content", "fault"), [(b"cut", "damaged"), (None, "missing")])
def test_a_sample_clip_that_is_not_the_shipped_one_is_refused(tmp_path, content, fault):
    (tmp_path / HASHES).write_text((FOLDER / HASHES).read_text())
    if content:
        (tmp_path / CLIP).write_bytes(content)
    with pytest.raises(InputError, match=rf"sample\.mp4: {fault}[\s\S]*install HydroViews again$"):
        copy_sample(tmp_path / "copies", tmp_path)
    assert not (tmp_path / "copies").exists()
