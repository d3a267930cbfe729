import errno
import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pycolmap
import pytest
from damage import contents, paint
from synthetic import capture_in

from hydroviews.dataset.build import build
from hydroviews.dataset.checks.verify import verify
from hydroviews.dataset.drawing_code import drawing_code
from hydroviews.dataset.manifest import data_hash, read_manifest
from hydroviews.dataset.rainy_variant import FOCAL_STEP
from hydroviews.dataset.variants import open_clean, open_variant
from hydroviews.errors import InputError
from hydroviews.files.atomic import read_json, write_bytes, write_json
from hydroviews.formats.read import read_scene
from hydroviews.formats.writers import write_colmap
from hydroviews.rain.lens.raindrops import Raindrops
from hydroviews.rain.patterns import Pattern
from hydroviews.rain.registry import find_effect
from hydroviews.rain.scene_statistics import survey
from hydroviews.rain.streaks import severity
from hydroviews.scene.images import image_size
from hydroviews.scene.scenes import make_scene, no_points

STREAK = Pattern("streak", 0)


@pytest.fixture
def scene(tmp_path):
    return capture_in(tmp_path / "capture" / "yard")


def test_a_build_holds_what_the_layout_promises(scene, tmp_path):
    folder = build(scene, tmp_path / "data", patterns=[STREAK], seed=3)
    names = [view.name for view in scene.views]
    for part, suffix in (("clean", "png"), ("streak-0/images", "png"), ("streak-0/layers", "exr")):
        assert sorted(p.name for p in (folder / part).iterdir()) == [f"{n}.{suffix}" for n in names]
    facts = read_json(folder / "streak-0" / "pattern.json")
    assert facts["seed"] == 3
    assert set(facts["parameters"]) == {"n", "length", "angle", "width", "brightness"}
    assert read_json(folder / "split.json")["test"] == names[::8]
    assert verify(tmp_path / "data", every_view=True) == []


def test_a_variant_opens_in_other_software_and_here(scene, tmp_path):
    folder = build(scene, tmp_path / "data", patterns=[STREAK])
    model = pycolmap.Reconstruction(folder / "streak-0" / "sparse" / "0")
    frames = {Path(f["file_path"]).name: f for f in read_json(folder / "streak-0" / "transforms.json")["frames"]}
    assert model.num_reg_images() == len(scene.views) == len(frames)
    given = {view.path.name: view.camera.world_to_camera for view in scene.views}
    for image in model.images.values():
        pose, opengl = given[image.name], np.array(frames[image.name]["transform_matrix"])
        assert np.allclose(image.cam_from_world().matrix(), pose[:3], atol=1e-9)
        assert np.allclose(np.linalg.inv(opengl @ np.diag([1.0, -1, -1, 1])), pose, atol=1e-9)
        assert (folder / "streak-0" / "images" / image.name).is_file()
        assert image.camera.model.name == "PINHOLE"
    clean, rainy = open_clean(folder), open_variant(folder, "streak-0")
    assert clean.split == rainy.split == scene.split
    assert len(rainy.points) == len(scene.points)
    assert np.array_equal(clean.views[0].image(), scene.views[0].image())
    assert not np.array_equal(rainy.views[0].image(), scene.views[0].image())


def test_rain_follows_from_the_seed_and_is_fresh_in_every_view_and_pattern(scene, tmp_path):
    patterns, seeds = [STREAK, Pattern("streak", 1)], {"a": 0, "b": 0, "c": 1}
    first, again, other = (
        contents(build(scene, tmp_path / out, patterns=patterns, seed=seed)) for out, seed in seeds.items()
    )
    assert first == again
    assert first["streak-0/images/view-00.png"] != other["streak-0/images/view-00.png"]
    assert len({first[f"{p.name}/layers/{v}.exr"] for p in patterns for v in ("view-00", "view-01")}) == 4
    one, two = (json.loads(first[f"{p.name}/pattern.json"])["parameters"] for p in patterns)
    assert one != two


def test_full_disk_then_resume(scene, tmp_path, monkeypatch):
    whole = contents(build(scene, tmp_path / "whole", patterns=[STREAK]))
    begin(scene, tmp_path / "data", monkeypatch)
    assert "yard" not in read_manifest(tmp_path / "data")["scenes"]
    assert contents(build(scene, tmp_path / "data", patterns=[STREAK])) == whole
    assert verify(tmp_path / "data") == []


def test_views_of_other_parameters_are_not_mixed_in(scene, tmp_path, monkeypatch):
    data = tmp_path / "data"
    finished = contents(build(scene, data, patterns=[Pattern("streak", 1)]) / "streak-1")
    begin(scene, data, monkeypatch)
    assert 0 < len(list((data / "yard" / "streak-0" / "images").iterdir())) < len(scene.views)
    monkeypatch.setitem(severity.LOSS, "light", 0.2)
    folder, whole = (build(scene, out, patterns=[STREAK]) for out in (data, tmp_path / "whole"))
    assert contents(folder / "streak-0") == contents(whole / "streak-0")
    assert contents(folder / "streak-1") == finished  # what was finished stays as it was
    assert verify(data, every_view=True) == []


def test_a_finished_scene_is_repaired_whatever_it_lost(scene, tmp_path):
    rains = [STREAK, Pattern("streak", 1)]
    folder = build(scene, tmp_path / "data", patterns=rains)
    whole = contents(folder)
    for names in (
        ["clean/view-03.png", "streak-0/images/view-04.png", "streak-0/layers/view-05.exr"],
        ["streak-0/statistics.csv", "streak-0/transforms.json"],
        ["streak-0/pattern.json"],
        ["streak-1/pattern.json"],
        ["streak-0/pattern.json", "streak-1/pattern.json"],
    ):
        for name in names:
            (folder / name).unlink()
        build(scene, tmp_path / "data", patterns=rains)
        assert contents(folder) == whole, names


def begin(scene, data: Path, monkeypatch) -> None:
    """Build until the disk is full, after some files."""
    done, real = [], os.replace

    def replace(source, target):
        done.append(target)
        if len(done) > 15:
            raise OSError(errno.ENOSPC, "No space left on device")
        real(source, target)

    with monkeypatch.context() as disk, pytest.raises(InputError, match="no space left"):
        disk.setattr("hydroviews.files.atomic.os.replace", replace)
        build(scene, data, patterns=[STREAK])


def test_another_request_is_refused_and_overwrite_builds_it(scene, tmp_path):
    build(scene, tmp_path / "data", patterns=[STREAK], long_side=32)
    with pytest.raises(InputError, match=r"another request[\s\S]*long_side 32"):
        build(scene, tmp_path / "data", patterns=[STREAK], long_side=24)
    folder = build(scene, tmp_path / "data", patterns=[STREAK], long_side=24, overwrite=True)
    assert image_size(folder / "clean" / "view-00.png") == (24, 18)
    assert verify(tmp_path / "data") == []
    paint(scene.views[0].path)  # another photograph of the same size
    with pytest.raises(InputError, match="another request"):
        build(scene, tmp_path / "data", patterns=[STREAK], long_side=24)


def test_rain_that_was_begun_and_not_ended_is_not_listed(scene, tmp_path):
    begun = build(scene, tmp_path, patterns=[STREAK], long_side=24) / "streak-2"
    write_bytes(begun / "pattern.json", b"{}")
    write_bytes(begun / "images" / "view-00.png", b"")
    build(scene, tmp_path, patterns=[STREAK, Pattern("streak", 1)], long_side=24)
    entry = read_manifest(tmp_path)["scenes"][scene.name]
    assert entry["patterns"] == ["streak-0", "streak-1"]
    assert not [name for name in entry["files"] if name.startswith("streak-2/")]
    assert any("streak-2" in problem and "not in the manifest" in problem for problem in verify(tmp_path))


def stamps(data: Path) -> dict[str, tuple[int, int]]:
    """Inode and time of change of every file: a file that is written anew has others, whatever it holds."""
    return {str(path): (path.stat().st_ino, path.stat().st_ctime_ns) for path in data.rglob("*") if path.is_file()}


def altered(monkeypatch) -> None:
    """From now on the code that draws is another."""
    monkeypatch.setattr("hydroviews.dataset.drawing_code._digest_of_ours", lambda: "another")


def test_a_finished_scene_of_another_generator_is_kept_and_nothing_is_added_to_it(scene, tmp_path, monkeypatch, caplog):
    data, more = tmp_path / "data", [STREAK, Pattern("streak", 1)]
    folder = build(scene, data, patterns=[STREAK])
    assert verify(data) == []
    assert "another generator" not in caplog.text
    altered(monkeypatch)
    before = stamps(data)
    assert build(scene, data, patterns=[STREAK]) == folder
    assert "this scene: drawn by another generator, kept; --overwrite builds anew" in caplog.text
    with pytest.raises(InputError, match=r"this scene: drawn by another generator[\s\S]*another[\s\S]*--overwrite"):
        build(scene, data, patterns=more)
    assert stamps(data) == before
    caplog.clear()
    assert verify(data) == []  # it is what its manifest says
    assert f"{folder}: this scene: drawn by another generator than this one" in caplog.text
    build(scene, data, patterns=more, overwrite=True)
    for made in (read_json(folder / "request.json"), read_json(folder / "streak-1" / "pattern.json")):
        assert made["drawing_code"] == "another"
    assert read_manifest(data)["scenes"]["yard"]["drawing_code"] == "another"


def test_what_an_interrupted_build_drew_with_other_code_is_not_mixed_in(scene, tmp_path, monkeypatch):
    begin(scene, tmp_path / "data", monkeypatch)
    altered(monkeypatch)
    with pytest.raises(InputError, match="another generator"):
        build(scene, tmp_path / "data", patterns=[STREAK])


def test_an_effect_of_ones_own_that_changed_is_another_generator(scene, tmp_path, monkeypatch, caplog):
    ash, data = Pattern("toy_effect.Ash", 0), tmp_path / "data"
    folder = build(scene, data, patterns=[ash, STREAK])
    finished = contents(folder / "streak-0")
    code = drawing_code(find_effect(ash.effect))
    assert code != drawing_code() == drawing_code(find_effect("streak"))
    monkeypatch.setattr("hydroviews.dataset.drawing_code.syntax_digest", lambda source: "another")
    build(scene, data, patterns=[ash])
    assert "toy_effect.Ash-0: drawn by another generator, kept" in caplog.text
    build(scene, data, patterns=[ash], overwrite=True)
    changed = read_json(folder / ash.name / "pattern.json")["drawing_code"]
    assert changed == drawing_code(find_effect(ash.effect)) != code
    assert contents(folder / "streak-0") == finished
    assert verify(data) == []


def test_a_capture_is_never_built_over(scene, tmp_path):
    capture = tmp_path / "capture" / "yard"
    before = contents(capture)
    for overwrite in (False, True):
        with pytest.raises(InputError, match="the capture itself would be overwritten"):
            build(scene, capture.parent, patterns=[STREAK], overwrite=overwrite)
    assert contents(capture) == before


def test_water_on_the_lens_is_made_ready_for_every_focal_length(scene, tmp_path, monkeypatch):
    class Dry:
        def __init__(self, camera, folder):
            self.camera, self.folder = camera, folder
            prepared.append(self)

        def layers(self, clean, view):
            assert view.camera.fx == pytest.approx(self.camera.fx, rel=FOCAL_STEP - 1)
            return dict.fromkeys("MVRGB", np.zeros(clean.shape[:2], np.float32))

    prepared, views = [], []
    for view, factor in zip(scene.views, 3 * [1.0, 1.01, 1.6], strict=True):
        camera = replace(view.camera, fx=factor * view.camera.fx, fy=factor * view.camera.fy)
        views.append(replace(view, camera=camera))
    monkeypatch.setattr(Raindrops, "prepare", lambda self, *facts: Dry(*facts))
    build(make_scene("yard", views, scene.points), tmp_path / "data", patterns=[Pattern("raindrop", 0)])
    assert 2 <= len({one.folder for one in prepared}) == len(prepared) <= 3  # 1 and 1.01 may lie on two sides of a step
    assert max(one.camera.fx for one in prepared) > 1.5 * min(one.camera.fx for one in prepared)


def test_views_of_one_size_are_not_wiped_by_those_of_another(scene, tmp_path):
    views = [replace(v, camera=v.camera.resized(*((48, 36), (40, 30))[i % 2])) for i, v in enumerate(scene.views)]
    two_sizes, ash = make_scene("yard", views, scene.points), Pattern("toy_effect.AshBySize", 0)
    folder = build(two_sizes, tmp_path / "data", patterns=[ash])
    images = sorted(path.name for path in (folder / ash.name / "images").iterdir())
    assert images == [f"{view.name}.png" for view in views]
    assert verify(tmp_path / "data", every_view=True) == []


def test_overwriting_a_scene_keeps_and_names_what_the_user_put_there(scene, tmp_path, caplog):
    folder = build(scene, tmp_path / "data", patterns=[STREAK], long_side=32)
    mine = {folder / "notes.txt": b"years of work", folder / "mine" / "a.png": b"a figure"}
    for path, content in mine.items():
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(content)
    for size in (24, 16):
        caplog.clear()
        build(scene, tmp_path / "data", patterns=[STREAK], long_side=size, overwrite=True)
        assert {path: path.read_bytes() for path in mine} == mine
        assert f"{folder}: not written by HydroViews, and kept: mine/a.png, notes.txt" in caplog.text
        assert image_size(next((folder / "clean").iterdir()))[0] == size


def test_a_wrong_licence_is_told_before_anything_is_built(scene, tmp_path):
    write_json(scene.views[0].path.parents[1] / "capture.json", {"licence": 5})
    with pytest.raises(InputError, match=r"capture\.json: licence"):
        build(scene, tmp_path / "data", patterns=[STREAK])
    assert not (tmp_path / "data").exists()


def test_what_a_capture_says_of_itself_belongs_to_the_request(scene, tmp_path):
    capture, storm = tmp_path / "capture" / "yard", [Pattern("storm", 0)]
    write_colmap(replace(scene, points=no_points()), capture / "sparse" / "0")
    with pytest.raises(InputError, match=r"how large the scene is[\s\S]*capture\.json"):
        build(read_scene(capture), tmp_path / "data", patterns=storm)
    write_json(capture / "capture.json", {"metres_per_unit": 0.5})
    folder = build(read_scene(capture), tmp_path / "data", patterns=storm)  # nothing was finished of it before
    parameters = read_json(folder / "storm-0" / "pattern.json")["parameters"]
    assert (parameters["metres_per_unit"], parameters["metres_estimated"]) == (0.5, False)
    write_json(capture / "capture.json", {"rain": "captured"})
    with pytest.raises(InputError, match=r"another request: yard has changed: .*or capture\.json\n"):
        build(read_scene(capture), tmp_path / "data", patterns=[])
    for odd in (0, -1, True, "2"):
        write_json(capture / "capture.json", {"metres_per_unit": odd})
        with pytest.raises(InputError, match=r"capture\.json: metres_per_unit"):
            read_scene(capture)


RECORD_OFTEN = """
import sys
from pathlib import Path
from hydroviews.dataset.manifest import record_scene
for turn in range(100):
    record_scene(Path(sys.argv[1]), sys.argv[2], {"patterns": [], "turn": turn})
"""


def test_scenes_that_are_recorded_at_the_same_time_all_stand_in_the_manifest(tmp_path):
    for name in "abc":
        (tmp_path / name).mkdir()
    command = [sys.executable, "-c", RECORD_OFTEN, str(tmp_path)]
    processes = [subprocess.Popen([*command, name], stderr=subprocess.DEVNULL) for name in "abc"]
    assert [process.wait(60) for process in processes] == [0, 0, 0]
    scenes = read_manifest(tmp_path)["scenes"]
    assert {name: scene["turn"] for name, scene in scenes.items()} == dict.fromkeys("abc", 99)


def test_an_unfinished_scene_does_not_verify(scene, tmp_path):
    folder = build(scene, tmp_path / "data", patterns=[])
    (tmp_path / "data" / "manifest.json").write_text('{"generator": "", "scenes": {}}')
    assert verify(tmp_path / "data") == [f"{folder}: not finished; run its build again, or remove that folder"]


@pytest.mark.parametrize("content", [None, "{", "{}", "[]", '{"scenes": {"yard": {}}}', "[" * 100_000, "1" * 5000])
def test_a_broken_or_missing_manifest_is_told(tmp_path, content):
    if content is not None:
        (tmp_path / "manifest.json").write_text(content)
    with pytest.raises(InputError, match=r"no manifest\.json|delete it and build again"):
        verify(tmp_path)


def test_the_hash_of_data_is_of_all_that_a_run_is_trained_and_scored_on(tmp_path):
    seen = ["clean/a.png", "sparse/0/images.bin", "split.json", "masks/a.png.png"]
    seen += ["streak-0/images/a.png", "streak-0/drops/a.png"]
    every = [*seen, "streak-0/layers/a.exr", "streak-1/images/a.png", "README.md"]

    def hashed(changed=None):
        scene = {"patterns": ["streak-0"], "files": {name: "ab"[name == changed] * 64 for name in every}}
        write_json(tmp_path / "manifest.json", {"scenes": {"yard": scene}})
        return data_hash(tmp_path, "yard", "streak-0")

    assert [name for name in every if hashed(name) != hashed()] == seen


def test_the_technique_of_drops_is_part_of_the_request_and_of_the_card(scene, tmp_path):
    folder = build(scene, tmp_path, patterns=[], lens_renderer="aperture")
    assert read_json(folder / "request.json")["lens_renderer"] == "aperture"
    assert "--lens-renderer aperture" in (folder / "README.md").read_text()
    with pytest.raises(InputError, match="lens_renderer disk"):
        build(scene, tmp_path, patterns=[])
    assert survey(scene, 0, "aperture").lens_renderer == "aperture"
