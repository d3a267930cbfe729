"""Data sets whose files were changed and their hashes renewed, or to which something was added: `verify` tells."""

import json
import shutil
from unittest.mock import Mock

import numpy as np
import pytest

from hydroviews.blender.process import NoBlender
from hydroviews.dataset.checks import rain
from hydroviews.dataset.checks.verify import verify
from hydroviews.dataset.manifest import read_manifest, record_files
from hydroviews.errors import InputError
from hydroviews.files.atomic import read_json, write_bytes, write_json
from hydroviews.rain.layers import read_layers, write_layers
from hydroviews.rain.streaks.effect import Streaks
from hydroviews.scene.images import read_image, write_png

PATTERN = "streak-1/pattern.json"


def sign(built, *names):
    record_files(built.parent, "yard", names)


def edit(built, name, change):
    """Change the value in a JSON file and renew its hash."""
    value = read_json(built / name)
    changed = change(value)
    write_json(built / name, value if changed is None else changed)
    sign(built, name)


def edit_manifest(built, change):
    manifest = read_manifest(built.parent)
    change(manifest["scenes"]["yard"])
    (built.parent / "manifest.json").write_text(json.dumps(manifest))


def told(built, every_view=False):
    return "\n".join(verify(built.parent, every_view))


def test_layers_are_drawn_again_from_their_seed(built):
    assert told(built, every_view=True) == ""
    edit(built, PATTERN, lambda facts: facts.update(seed=5))
    assert f"{PATTERN}: not what seed 5 gives: angle" in told(built)


def test_layers_that_another_seed_drew(built):
    facts = read_json(built / PATTERN)
    for view, every_view in (("view-00", False), ("view-03", True)):
        layer, image = f"streak-1/layers/{view}.exr", f"streak-1/images/{view}.png"
        layers = {"S": np.ascontiguousarray(read_layers(built / layer)["S"][::-1, ::-1])}
        write_layers(built / layer, layers)
        write_png(built / image, rain.expected_view(facts, read_image(built / f"clean/{view}.png"), layers))
        sign(built, layer, image)
        assert f"{layer}: not what seed and parameters give: S" in told(built, every_view)
    assert "view-03" not in told(built)  # one view a variant


@pytest.mark.parametrize("name", [".evil", "yard/.evil", "yard/clean/.evil", "yard/streak-1/extra.png", "notes.txt"])
def test_stray_files(built, name):
    (built.parent / name).touch()
    assert f"{built.parent / name}: not in the manifest" in told(built)


def test_what_commands_leave_beside_is_no_stray(built):
    for name in ("sheets/yard.png", "captures/courtyard/images/a.png", ".lock-yard", "yard/streak-1/.lens/a.npz"):
        (built.parent / name).parent.mkdir(parents=True, exist_ok=True)
        (built.parent / name).touch()
    assert told(built) == ""


def test_a_variant_that_is_not_listed(built):
    edit_manifest(built, lambda entry: entry.update(patterns=["storm-1"]))
    assert f"{built / 'streak-1'}: a variant that the manifest does not list" in told(built)


@pytest.mark.parametrize("said", [5, {}, {"metres_per_unit": "x", "clean_error": None, "drops_cost": 1.0}])
def test_odd_words_on_the_capture(built, said):
    edit_manifest(built, lambda entry: entry.update(capture=said))
    assert "the manifest's word on its capture" in told(built)


def test_a_view_without_a_picture(built):
    names = ("streak-1/images/view-03.png", "streak-1/layers/view-03.exr")
    for name in names:
        (built / name).unlink()
    edit_manifest(built, lambda entry: [entry["files"].pop(name) for name in names])
    assert f"{built / 'streak-1/images'}: no picture of view-03" in told(built)


@pytest.mark.parametrize("project", ["", "streak-1/"])
@pytest.mark.parametrize(
    ("change", "where"),
    [
        (lambda content: content["frames"][2].update(fl_x=5.0), ": .*view-02.png"),
        (lambda content: content["frames"][1]["transform_matrix"][0].__setitem__(3, 9.0), ": .*view-01.png"),
        (lambda content: content["frames"].pop(), ""),
        (lambda content: content.update(ply_file_path="../../elsewhere.ply"), ""),
        (lambda content: {"frames": 5}, ""),
        (lambda content: [], ""),
    ],
)
def test_transforms_are_the_cameras_once_more(built, project, change, where):
    edit(built, f"{project}transforms.json", change)
    (problem,) = verify(built.parent)
    assert problem.startswith(f"{built}/{project}transforms.json: not the cameras of sparse/0")
    assert ("view-" in problem) == bool(where)


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda split: split["train"].append(split["test"][0]), "lists views twice"),
        (lambda split: split["train"].remove("view-02"), "neither to train on nor held out: view-02"),
        (lambda split: split["test"].append("view-77"), "names views that are not there"),
        (lambda split: split.update(sparse=["view-00", "view-01"]), "no choice of its training views"),
        (lambda split: split.update(train=5), "not a split"),
    ],
)
def test_the_split_is_disjoint_and_complete(built, change, expected):
    edit(built, "split.json", change)
    assert expected in told(built)


@pytest.mark.parametrize("name", ["clean/view-01.png", "clean", "streak-1", "streak-1/sparse", ""])
def test_links_are_told_and_not_followed(built, tmp_path, name, monkeypatch):
    place, away = built / name, tmp_path / "away"
    target = away / place.name
    away.mkdir()
    if place.is_symlink():
        shutil.copytree(built / "sparse", target)
        place.unlink()
    else:
        shutil.move(place, target)
    place.symlink_to(target)
    read = []
    for reader in ("manifest.current_sha256", "checks.cameras.sha256", "checks.rain.read_image"):
        monkeypatch.setattr(f"hydroviews.dataset.{reader}", lambda path: read.append(path) or "0")
    assert f"{place}: a link, which may lead out of the data set" in verify(built.parent)
    assert not [path for path in read if target in path.resolve().parents or target == path.resolve()]


def test_links_in_a_copy_of_the_cameras_and_a_linked_manifest(built, tmp_path):
    (built / "streak-1/sparse").unlink()
    shutil.copytree(built / "sparse", built / "streak-1/sparse")
    assert told(built) == ""
    cameras, manifest = built / "streak-1/sparse/0/cameras.bin", built.parent / "manifest.json"
    cameras.symlink_to(shutil.move(cameras, tmp_path / cameras.name))
    assert f"{cameras}: a link, which may lead out of the data set" in told(built)
    manifest.symlink_to(shutil.move(manifest, tmp_path / manifest.name))
    with pytest.raises(InputError, match=r"no manifest\.json\n  found: a link"):
        told(built)


@pytest.mark.parametrize(
    "change",
    [
        *(
            lambda facts, odd=odd: facts["parameters"].update(odd)
            for odd in ({"brightness": "x"}, {"brightness": None}, {"n": [1]}, {"length": {"a": 1}})
        ),
        *(lambda facts, seed=seed: facts.update(seed=seed) for seed in ("0", True, -1)),
        *(lambda facts, name=name: facts.update(effect=name) for name in (["streak"], "no-such-effect")),
        *(lambda facts, odd=odd: facts.update(parameters=odd) for odd in (5, {"n": 100})),  # none, too few
        lambda facts: facts.update(index="1"),
        lambda facts: [],
    ],
)
def test_odd_values_in_a_pattern(built, change):
    edit(built, PATTERN, change)
    assert told(built).strip()


@pytest.mark.parametrize("name", ["split.json", "transforms.json", "streak-1/transforms.json", PATTERN, "request.json"])
@pytest.mark.parametrize("content", [b"\xff", b"5", b"[" * 100_000, b'{"a": 1}'])
def test_odd_json_is_told(built, name, content, caplog):
    write_bytes(built / name, content)
    sign(built, name)
    assert name.partition(".")[0] in told(built) + caplog.text or "another generator" in caplog.text


@pytest.mark.parametrize("name", ["sparse/0/cameras.bin", "sparse/0/images.bin", "sparse/0/points3D.bin"])
@pytest.mark.parametrize("content", [b"", b"\x01" * 64])
def test_an_odd_model_is_told(built, name, content):
    write_bytes(built / name, content)
    sign(built, name)
    said = told(built)
    assert "damaged or cut short" in said or "camera model number 16843009: unknown" in said


def test_what_was_not_drawn_again_is_said(built, monkeypatch, caplog):
    no_blender = NoBlender("Blender's Python module bpy is not installed", fix="install it")
    with monkeypatch.context() as without:
        without.setattr(Streaks, "prepare", Mock(side_effect=no_blender))
        assert told(built) == ""
    assert "streak-1: layers were not drawn again: Blender's Python module bpy is not installed\n" in caplog.text
    edit_manifest(built, lambda entry: entry.pop("capture"))
    assert told(built) == ""
    assert "built by an older version: layers were not drawn again" in caplog.text
    assert "capture" not in read_manifest(built.parent)["scenes"]["yard"]
