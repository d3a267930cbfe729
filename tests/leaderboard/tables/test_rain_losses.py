"""What plain 3DGS loses to a scene's rain, from a results folder into the scene's card."""

import shutil
from dataclasses import fields, replace
from pathlib import Path

import pandas as pd
import pytest
from built_yard import STREAKS, built_yard
from kept_blender import kept_blender  # noqa: F401
from synthetic import capture_in

from hydroviews.dataset.build import build
from hydroviews.dataset.checks.verify import verify
from hydroviews.dataset.manifest import data_hash
from hydroviews.errors import InputError
from hydroviews.files.atomic import read_json
from hydroviews.formats.read import read_scene
from hydroviews.rain.lens.optics import bake
from hydroviews.rain.lens.patterns.pattern import RaindropPattern
from hydroviews.rain.lens.severity import drops_harm, veil_harm
from hydroviews.rain.patterns import Pattern
from hydroviews.rain.scene_statistics import survey
from hydroviews.rain.severity import wanted_harm
from leaderboard.__main__ import enter_losses
from leaderboard.tables.rain_losses import numbers_for_grades, record_losses, rewrite_card


@pytest.fixture(scope="module")
def built_once(tmp_path_factory) -> Path:
    return built_yard(tmp_path_factory.mktemp("built"))


@pytest.fixture
def built(built_once, tmp_path) -> Path:
    """A built scene, for the test to change."""
    return Path(shutil.copytree(built_once.parent, tmp_path / "data")) / built_once.name


def results_in(folder: Path, built: Path, **changes) -> Path:
    """A results folder with one run of each reference on each variant, two tracks, two seeds."""
    rows = []
    for track, penalty in (("given-poses", 0), ("sparse-views", 4)):
        for seed in (0, 1):
            runs = [("3dgs-clean", "clean", 26 + seed), ("3dgs", "streak-0", 24.5), ("3dgs", "streak-2", 17.25)]
            for method, pattern, psnr in [*runs, ("ours", "streak-2", 25)]:
                facts = {"scene": built.name, "profile": "demo", "track": track, "seed": seed, "status": "done"}
                facts |= {"psnr": psnr - penalty, "data_sha256": data_hash(built.parent, built.name, pattern)}
                rows.append(facts | {"method": method, "pattern": pattern} | changes)
    folder.mkdir(parents=True)
    pd.DataFrame(rows).to_csv(folder / "leaderboard.csv", index=False)
    return folder


def test_a_card_written_again_is_the_same(built):
    card = (built / "README.md").read_text()
    rewrite_card(built)
    assert (built / "README.md").read_text() == card


def test_losses_are_those_of_the_runs_and_stay(tmp_path):
    built = built_yard(tmp_path)
    record_losses(built, results_in(tmp_path / "results", built))
    card = (built / "README.md").read_text()
    assert "| streak-0 | light | given-poses | 26.50 dB | 24.50 dB | 2.00 dB | 2 |" in card
    assert "| streak-2 | heavy | sparse-views | 22.50 dB | 13.25 dB | 9.25 dB | 2 |" in card
    assert verify(built.parent) == []
    rewrite_card(built)
    assert (built / "README.md").read_text() == card
    (built / "statistics.csv").unlink()  # a repair by the same build
    capture = tmp_path / "capture" / "yard"
    build(capture_in(capture), built.parent, patterns=STREAKS, seed=5, source=str(capture))
    assert (built / "README.md").read_text() == card
    assert verify(built.parent) == []


@pytest.mark.parametrize("change", [{"data_sha256": "of another build"}, {"status": "failed"}, {"scene": "other"}])
def test_runs_on_other_data_do_not_count(built, tmp_path, change):
    results = results_in(tmp_path / "results", built, **change)
    with pytest.raises(InputError, match="no pair of finished runs"):
        record_losses(built, results)
    assert not (built / "losses.csv").exists()


def test_no_leaderboard(built, tmp_path):
    for content in (None, "", "method,scene\n3dgs,yard\n"):
        if content is not None:
            (tmp_path / "leaderboard.csv").write_text(content)
        with pytest.raises(InputError, match="no leaderboard"):
            record_losses(built, tmp_path)


def test_a_scene_without_runs_does_not_hold_up_the_others(built, tmp_path, capsys):
    build(capture_in(tmp_path / "capture" / "another"), built.parent, patterns=STREAKS)
    with pytest.raises(InputError, match="no pair of finished runs of 3dgs-clean and 3dgs on another"):
        enter_losses(built.parent, results_in(tmp_path / "results", built))
    assert "streak-2" in capsys.readouterr().out
    assert (built / "losses.csv").is_file()


def test_a_scene_may_be_called_by_a_number(tmp_path):
    built = build(capture_in(tmp_path / "capture" / "0042"), tmp_path / "data", patterns=STREAKS)
    losses = record_losses(built, results_in(tmp_path / "results", built))
    assert list(losses.pattern) == ["streak-0", "streak-2"] * 2


@pytest.fixture(scope="module")
def in_drops(tmp_path_factory, kept_blender):  # noqa: F811
    """A scene that is built in medium drops."""
    folder = tmp_path_factory.mktemp("drops")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(bake, "run_blender", kept_blender)
        return build(capture_in(folder / "capture" / "yard"), folder / "data", patterns=(Pattern("raindrop", 1),))


def losses_of(*rows: tuple) -> pd.DataFrame:
    return pd.DataFrame(rows, columns=["pattern", "track", "clean", "rainy"])


def test_measured_numbers_meet_the_grade(in_drops):
    """With them the predicted loss is the one that was measured."""
    losses = losses_of(("raindrop-1", "given-poses", 26.0, 20.0), ("raindrop-1", "sparse-views", 19.0, 17.0))
    numbers = numbers_for_grades(in_drops, losses)
    statistics = replace(survey(read_scene(in_drops), 0), **numbers)
    drawn = read_json(in_drops / "raindrop-1" / "pattern.json")["parameters"]
    pattern = RaindropPattern(**{field.name: drawn[field.name] for field in fields(RaindropPattern)})
    harm = drops_harm(pattern.coverage, statistics) + veil_harm(pattern, statistics)(pattern.mist)
    assert harm == pytest.approx(wanted_harm(6.0, statistics), rel=0.02)  # of numbers with two decimals


def test_mist_that_explains_more_than_all_leaves_the_drops_unmeasured(in_drops):
    losses = losses_of(("raindrop-1", "given-poses", 26.0, 25.99))
    assert list(numbers_for_grades(in_drops, losses)) == ["clean_error"]


@pytest.mark.parametrize("row", [("streak-0", "sparse-views", 20.0, 18.0), ("captured-0", "given-poses", 26.0, 20.0)])
def test_other_tracks_and_real_rain_give_no_numbers(tmp_path, row):
    assert numbers_for_grades(tmp_path, losses_of(row)) == {}
