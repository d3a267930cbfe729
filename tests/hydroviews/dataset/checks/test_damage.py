"""Files of a finished scene that changed: never opened, never taken for good ones, made again if asked to."""

import json
import os
import re
import shutil
import stat
from unittest.mock import Mock, call

import numpy as np
import pytest
from damage import contents, damage, paint
from in_the_way import KINDS, not_for_ever, swap

from hydroviews.dataset.build import build
from hydroviews.dataset.checks.verify import verify
from hydroviews.dataset.manifest import changed_files, read_manifest, record_files, scene_files
from hydroviews.dataset.variants import open_clean, open_variant
from hydroviews.errors import InputError
from hydroviews.files import known_bytes
from hydroviews.files.atomic import sha256, write_bytes
from hydroviews.formats.read import read_scene
from hydroviews.rain.patterns import Pattern
from hydroviews.scene.images import write_png
from hydroviews.scene.masks import write_ignored

STREAK, HEAVY = Pattern("streak", 1), Pattern("streak", 2)


def again(built, **changes):
    capture = read_scene(built.parents[1] / "capture" / "yard")
    return build(capture, built.parent, **{"patterns": [STREAK], **changes})


@pytest.mark.parametrize(
    ("name", "read"),
    [
        ("clean/view-00.png", lambda folder: [view.image() for view in open_clean(folder).test_views]),
        ("streak-1/images/view-01.png", lambda folder: open_variant(folder, "streak-1").train_views[0].image()),
        ("masks/view-03.png.png", lambda folder: [view.ignored() for view in open_clean(folder).views]),
        ("sparse/0/images.bin", open_clean),
        ("sparse/0/points3D.bin", lambda folder: open_variant(folder, "streak-1")),
        ("split.json", open_clean),
    ],
)
def test_a_file_that_changed_is_named_and_not_read(built, name, read):
    read(built)
    damage(built / name)
    with pytest.raises(InputError, match=f"{name}: changed since it was built"):
        read(built)


@pytest.mark.parametrize("kind", KINDS)
def test_something_else_where_a_file_belongs_is_a_problem_and_the_rest_is_looked_at(built, kind):
    names = ["split.json", "request.json", "transforms.json", "README.md", "clean/view-00.png", "masks/view-03.png.png"]
    names += ["sparse/0/images.bin", "sparse/0/points3D.bin"]
    names += [f"streak-1/{name}" for name in ("pattern.json", "statistics.csv", "transforms.json")]
    names += ["streak-1/images/view-01.png", "streak-1/layers/view-01.exr"]
    damage(built / "clean/view-02.png")
    for name in names:
        swap(built / name, kind)
    with not_for_ever():
        problems = "\n".join(verify(built.parent))
    assert [name for name in names if f"{built / name}: not a file, found: a {kind}" not in problems] == []
    assert f"{built / 'clean/view-02.png'}: changed since it was built" in problems
    swap(built.parent / "manifest.json", kind)
    with not_for_ever(), pytest.raises(InputError, match=rf"manifest\.json: not a file\n +found: a {kind}"):
        read_manifest(built.parent)


def test_what_is_not_listed_is_not_read(built):
    shutil.copytree(built / "sparse" / "0", built / "sparse" / "1")
    (built / "streak-1" / "split.json").write_text('{"train": ["view-00", "view-08"], "test": ["view-01"]}')
    write_ignored(built / "masks" / "smuggled.png.png", np.ones((36, 48), bool))
    assert open_variant(built, "streak-1").split.test == ("view-00", "view-08")
    shutil.copytree(built / "streak-1", built / "streak-2", symlinks=True)
    with pytest.raises(InputError, match="streak-2/images: views that are not in the manifest"):
        open_variant(built, "streak-2")
    (built / "depth").mkdir()
    (built / "depth" / "view-02.exr").touch()
    with pytest.raises(InputError, match=r"depth/view-02\.exr: not in the manifest"):
        open_clean(built)


def test_a_file_is_hashed_once_until_it_is_touched(built, monkeypatch):
    path, hashed = built / "clean" / "view-00.png", Mock(side_effect=sha256)
    view = open_clean(built).test_views[0]
    monkeypatch.setattr(known_bytes, "sha256", hashed)
    monkeypatch.setattr(known_bytes, "SETTLED", 0)
    for _ in range(3):
        view.image()
    hashed.assert_called_once_with(path)
    content, times = path.read_bytes(), path.stat()
    write_bytes(path, content[:-1] + b"x")
    os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))  # as large and as old as it was
    with pytest.raises(InputError, match="changed"):
        view.image()
    write_bytes(path, content)
    assert view.image().shape == (36, 48, 3)
    monkeypatch.setattr(known_bytes, "SETTLED", 1e18)  # it could be touched again before a clock ticks
    hashed.reset_mock()
    write_bytes(path, content)
    view.image(), view.image()
    assert hashed.call_args_list == [call(path), call(path)]


def test_a_painted_view_is_not_taken_for_a_good_one(built):
    before = read_manifest(built.parent)
    paint(built / "clean" / "view-05.png")
    for patterns in ([STREAK], [STREAK, HEAVY], []):
        with pytest.raises(InputError, match=r"clean/view-05\.png: changed or missing[\s\S]*--repair"):
            again(built, patterns=patterns)
    assert read_manifest(built.parent) == before
    assert not (built / "streak-2").exists()


def test_other_rain_that_changed_holds_up_what_is_added_alone(built):
    again(built, patterns=[HEAVY])
    paint(built / "streak-2" / "images" / "view-05.png")
    again(built)
    with pytest.raises(InputError, match="streak-2/images/view-05"):
        again(built, patterns=[Pattern("streak", 0)])


@pytest.mark.parametrize(
    "names",
    [
        ["clean/view-05.png", "streak-1/layers/view-04.exr", "README.md"],
        ["sparse/0/cameras.bin", "transforms.json", "streak-1/transforms.json", "split.json"],
        ["streak-1/pattern.json", "statistics.csv", "streak-1/statistics.csv", "masks/view-00.png.png"],
    ],
)
def test_repair_makes_the_same_bytes_again(built, names, caplog):
    whole = contents(built)
    for name in names:
        damage(built / name)
    again(built, repair=True)
    assert f"{len(names)} changed files are made again" in caplog.text
    assert contents(built) == whole
    assert verify(built.parent, every_view=True) == []


def test_a_repair_that_was_interrupted_is_ended_by_the_next_build(built, monkeypatch):
    whole, full = contents(built), Mock(side_effect=InputError("no space left on the disk"))
    for name in ("clean/view-05.png", "sparse/0/cameras.bin", "streak-1/images/view-04.png"):
        damage(built / name)
    with monkeypatch.context() as disk, pytest.raises(InputError, match="no space left"):
        disk.setattr("hydroviews.dataset.clean_views.write_colmap", full)
        again(built, repair=True)
    assert not (built / "sparse" / "0").exists()
    again(built)
    assert contents(built) == whole
    assert verify(built.parent) == []


def test_what_cannot_be_repaired_is_refused(built, monkeypatch):
    view, way_out = built / "clean" / "view-02.png", r": changed[\s\S]*or remove .*yard and build it again"
    damage(built / "request.json")
    with pytest.raises(InputError, match=rf"request\.json{way_out}"):
        again(built, repair=True)
    shutil.rmtree(built)
    assert again(built) == built
    damage(view)
    with monkeypatch.context() as other, pytest.raises(InputError, match=rf"view-02\.png{way_out}"):
        other.setattr("hydroviews.dataset.drawing_code._digest_of_ours", lambda: "another")
        again(built, repair=True)
    assert view.is_file()
    monkeypatch.setattr("hydroviews.dataset.clean_views.write_png", lambda path, image: write_png(path, image * 0.9))
    with pytest.raises(InputError, match=r"view-02\.png: changed or missing"):  # another machine's bytes
        again(built, repair=True)
    assert changed_files({view: "of before"}, "") == [view]


def test_finished_files_are_read_only_and_can_be_replaced(built):
    modes = {stat.S_IMODE(path.stat().st_mode) for path in scene_files(built)}
    assert modes == {0o444}
    write_bytes(built / "README.md", b"annotated")
    record_files(built.parent, "yard", ["README.md"])
    assert stat.S_IMODE((built / "README.md").stat().st_mode) == 0o444
    shutil.rmtree(built)


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        *(({"files": {name: "0"}}, f"file '{name}'") for name in ("../../../etc/passwd", "/etc/passwd", "a//b")),
        ({"files": {"a": 5}}, "file 'a'"),
        ({"files": ["a"]}, "no files"),
        ({"patterns": None}, "patterns None"),
        ({"held_back": 5}, "held_back 5"),
        ({"patterns": [["streak-1"]]}, "patterns"),
        ({"patterns": ["../streak-1"]}, "patterns"),
    ],
)
def test_odd_manifests_are_refused_by_all_who_read_them(built, change, expected):
    manifest = read_manifest(built.parent)
    entry = manifest["scenes"]["yard"]
    files = entry["files"]
    entry.update(change)
    if isinstance(entry["files"], dict):
        entry["files"] = files | entry["files"]
    (built.parent / "manifest.json").write_text(json.dumps(manifest))
    for read in (lambda: verify(built.parent), lambda: open_clean(built), lambda: again(built)):
        with pytest.raises(InputError, match=rf"not a manifest, scene 'yard'[\s\S]*{re.escape(expected)}"):
            read()


@pytest.mark.parametrize("name", ["../../../../etc", "/etc", "..", ".", "", "a/b"])
def test_scenes_that_lie_elsewhere_are_refused(tmp_path, name):
    (tmp_path / "manifest.json").write_text(json.dumps({"scenes": {name: {"files": {}, "patterns": []}}}))
    with pytest.raises(InputError, match=r"not a manifest[\s\S]*a name that is no folder's"):
        verify(tmp_path)
