import shutil
from pathlib import Path

import numpy as np
import pytest
from shared_data_set import facts_of
from synthetic import written_capture

from hydroviews.dataset.build import build
from hydroviews.dataset.card.contact_sheet import write_sheets
from hydroviews.dataset.checks.rain import expected_view
from hydroviews.dataset.checks.verify import verify
from hydroviews.dataset.manifest import record_files, record_scene
from hydroviews.files.atomic import write_bytes
from hydroviews.formats.capture_json import CAPTURED
from hydroviews.formats.read import read_scene
from hydroviews.rain.layers import read_layers, write_layers
from hydroviews.rain.registry import find_effect
from hydroviews.scene.images import read_image, write_png


def problems_after_signing(built: Path) -> str:
    """What verify says once the manifest has the hashes of the files as they are now."""
    record_scene(built.parent, "yard", facts_of(built))
    return "\n".join(verify(built.parent, every_view=True))


def test_a_scene_is_verified_alone(built):
    assert verify(built, every_view=True) == []
    (built.parent / "stray.txt").touch()
    assert verify(built) == []
    (built / "stray.txt").touch()
    assert [str(built / "stray.txt") in problem for problem in verify(built)] == [True]


@pytest.mark.parametrize("pattern", ["streak-1", "storm-1"])
def test_a_view_that_does_not_follow_from_its_layers(built, pattern):
    image = built / pattern / "images" / "view-03.png"
    pixels = read_image(image)
    pixels[5, 7] = np.clip(pixels[5, 7] + 2 / 255, 0, 1)
    write_png(image, pixels)
    record_files(built.parent, "yard", [f"{pattern}/images/view-03.png"])
    assert f"{image}: differs by 2" in verify(built.parent, every_view=True)[0]
    assert verify(built.parent) == []  # the first view alone is as it was


@pytest.mark.parametrize(
    ("pattern", "change", "expected"),
    [
        ("storm-1", lambda layers: layers | {"M": layers["M"] - 0.5}, "M is outside 0 to 1"),
        ("storm-1", lambda layers: layers | {"R": layers["R"] * np.nan}, "R is outside 0 to inf"),
        ("storm-1", lambda layers: {k: v for k, v in layers.items() if k != "V"}, "channels B, G, M, R, expected"),
        ("streak-1", lambda layers: {"S": layers["S"][:-1]}, "S has another size"),
    ],
)
def test_layers_that_are_none(built, pattern, change, expected):
    path = built / pattern / "layers" / "view-00.exr"
    write_layers(path, change(read_layers(path)))
    assert f"view-00.exr: {expected}" in problems_after_signing(built)


def test_statistics_are_there_and_true(built):
    path = built / "streak-1" / "statistics.csv"
    head, first, _, *rest = path.read_text().splitlines()
    cells = first.split(",")
    cells[3] = "0.9"  # streaks of view-00
    write_bytes(path, ("\n".join([head, ",".join(cells), *rest]) + "\n").encode())
    problems = problems_after_signing(built)
    assert "streaks of view-00 is 0." in problems
    assert "no row for view-01" in problems
    path.unlink()
    assert "no statistics.csv; run the build again" in problems_after_signing(built)


def test_a_scene_captured_in_rain_has_its_hashes_checked_and_its_row(tmp_path):
    capture = written_capture(tmp_path / "capture" / "yard")
    (capture / "capture.json").write_text('{"rain": "captured"}')
    folder = build(read_scene(capture), tmp_path / "data", patterns=[])
    assert verify(tmp_path / "data") == []
    assert "it rained when the photographs were taken" in (folder / "README.md").read_text()
    assert [sheet.name for sheet in write_sheets(folder, columns=2)] == ["yard.png"]
    image = folder / CAPTURED / "images" / "view-02.png"
    write_png(image, read_image(image) * 0.5)
    assert verify(folder) == [f"{image}: changed since it was built"]


@pytest.mark.parametrize("effect", ["streak", "raindrop", "storm"])
def test_the_equations_are_those_of_the_composite(effect):
    rng = np.random.default_rng(0)
    clean = rng.random((20, 30, 3)).astype(np.float32)
    clean[0], clean[1] = 0, 1
    planes = {name: rng.random((20, 30)).astype(np.float32) for name in ("MVRGB" if effect != "streak" else "S")}
    if effect != "streak":
        planes["R"] *= 8  # a lamp in a drop
        planes["M"][2], planes["V"][3] = 1, 1
    facts = {"effect": effect, "parameters": {"brightness": 0.93}}
    built = find_effect(effect).composite(facts["parameters"], clean, planes)
    assert np.abs(expected_view(facts, clean, planes) - built).max() < 2e-6


def test_cameras_of_a_variant_are_the_scenes(built):
    link = built / "streak-1" / "sparse"
    link.unlink()
    assert "not the scene's sparse" in "\n".join(verify(built.parent))
    shutil.copytree(built / "sparse", link)  # as where links cannot be made, or after a copy that follows them
    assert verify(built.parent) == []
    write_bytes(link / "0" / "cameras.bin", b"")
    assert "not the scene's sparse" in "\n".join(verify(built.parent))
