from pathlib import Path

import pytest
from commands import command
from synthetic import written_capture

from hydroviews.dataset.checks.verify import verify
from hydroviews.dataset.manifest import read_manifest
from hydroviews.dataset.suites import DEVELOPMENT, TEST, build_suite, read_suite, suite_of
from hydroviews.profiles import find_profile

OWN = """
title = "Two yards and a moon"
patterns = [0, 2]

[scenes]
"{root}/yard" = ["streak"]
moon = ["streak"]
"mipnerf360/garden" = ["raindrop"]
"{root}/other yard" = []
"""


@pytest.fixture
def suite(tmp_path):
    for name in ("yard", "other yard"):
        written_capture(tmp_path / "root" / name)
    path = tmp_path / "own.toml"
    path.write_text(OWN.format(root=tmp_path / "root"))
    return path


def test_what_is_missing_does_not_hold_up_the_rest(suite, tmp_path):
    data, root = tmp_path / "data", tmp_path / "root"

    def built():
        failures = build_suite(read_suite(str(suite)), data, find_profile("demo"), captures=root)
        return list(failures), {name: scene["patterns"] for name, scene in read_manifest(data)["scenes"].items()}

    yards = {"yard": ["streak-0", "streak-2"], "other yard": []}
    assert built() == (["moon", "mipnerf360/garden"], yards)
    assert verify(data) == []
    stamp = (data / "yard" / "streak-0" / "pattern.json").stat().st_mtime_ns
    written_capture(root / "garden", seed=1)
    suite.write_text(suite.read_text().replace('["raindrop"]', '["streak"]'))
    assert built() == (["moon"], {**yards, "mipnerf360_garden": ["streak-0", "streak-2"]})
    assert (data / "yard" / "streak-0" / "pattern.json").stat().st_mtime_ns == stamp


def test_the_command_reports_and_ends_with_status_1(suite, tmp_path, monkeypatch):
    monkeypatch.chdir(Path(__file__).parents[3])
    line = ["hydroviews", "build", "--suite", str(suite), "--out", str(tmp_path / "data")]
    line += ["--captures", str(tmp_path / "nothing")]
    result = command(*line)
    assert result.returncode == 1, result.stderr
    assert "Two yards and a moon: 2 of 4 scenes are built" in result.stdout
    assert "SCENE=mipnerf360/garden" in result.stdout
    assert "hydroviews download mipnerf360/garden" in result.stdout
    result = command(*line, "--patterns", "streak-0")
    assert result.returncode == 2
    assert "--suite with --patterns" in result.stderr


@pytest.mark.parametrize(
    ("names", "suite"),
    [
        (("courtyard", "llff_flower", "mipnerf360_bonsai"), DEVELOPMENT),
        (("room", "street", "pond", "market", "ngp_fox"), TEST),
        (("yard", "mipnerf360/bonsai", ""), ""),
    ],
)
def test_a_built_scene_is_for_choosing_or_for_judging_or_for_neither(names, suite):
    assert {suite_of(name) for name in names} == {suite}
